#pragma once
/// TOML text to value tree and back.

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "protocols/config/value.hpp"

namespace meltbench::config {

/// Larger files are refused: what a person writes is a hundred times smaller.
inline constexpr std::size_t kMaxFileBytes = 4U << 20;

/// Reads TOML 1.0. Safe on any bytes: depth, size and repeated keys are bounded or refused.
/// @param file_name  for messages only.
/// @throws ConfigError with line and column: syntax, a key given twice, a date, nesting too deep.
[[nodiscard]] Table parse_toml(std::string_view text, std::string_view file_name);

/// All of a file; with read_toml_file() the only I/O here.
/// @param asked_by  where the file was named ("rig = ..."): complaints point there.
/// @throws ConfigError if it cannot be read or is larger than kMaxFileBytes.
[[nodiscard]] std::string read_text_file(const std::filesystem::path& file, const Origin& asked_by = {});

/// @throws ConfigError as read_text_file() and parse_toml().
[[nodiscard]] std::shared_ptr<const Table> read_toml_file(const std::filesystem::path& file,
                                                          const Origin& asked_by = {});

/// TOML text of a tree, in the tree's own order; equal trees give equal bytes. parse_toml() of it gives an equal tree
/// (each double bit for bit) if in every table the plain values stand before the tables; otherwise it puts them there.
[[nodiscard]] std::string write_toml(const Table& table);

/// One value as TOML writes it: 0.1, "text", [1, 2]. For messages too.
[[nodiscard]] std::string write_toml(const Value& value);

}  // namespace meltbench::config
