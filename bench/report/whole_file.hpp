#pragma once
/// Files that appear whole or not at all.

#include <filesystem>
#include <string_view>

namespace meltbench::report {

/// Writes `text` beside `path` and renames it into place: who reads `path` sees the old file or the new one, never
/// half.
/// @throws std::system_error naming the path.
void write_whole_file(const std::filesystem::path& path, std::string_view text);

}  // namespace meltbench::report
