#pragma once
/// Text made harmless for where it is put.

#include <string>
#include <string_view>

namespace meltbench::report {

/// For HTML and XML, in text and in quoted attributes: & < > " ' are escaped; bytes that XML 1.0 forbids, and bytes
/// that are not UTF-8, become U+FFFD.
[[nodiscard]] std::string escape_markup(std::string_view text);

/// JSON text for inside <script>: "</" and "<!--" cannot appear, nor the two line separators that old scripts break at.
/// @param json  valid JSON.
[[nodiscard]] std::string escape_script_json(std::string_view json);

}  // namespace meltbench::report
