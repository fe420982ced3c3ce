#include "bench/cli/log_commands.hpp"

#include <fmt/format.h>

#include "bench/log/log_error.hpp"
#include "bench/log/log_reader.hpp"
#include "bench/log/log_writer.hpp"

namespace meltbench::cli {
void print_log_warnings(const log::LogReader& reader, const std::filesystem::path& path) {
  for (const log::LogWarning& warning : reader.warnings()) {
    const std::string place = warning.line == 0 ? "" : fmt::format(":{}", warning.line);
    fmt::print(stderr, "warning: {}{}: {}\n", path.string(), place, warning.text);
  }
  if (reader.warning_count() > reader.warnings().size()) {
    fmt::print(stderr, "warning: and {} more\n", reader.warning_count() - reader.warnings().size());
  }
}

ExitStatus convert_log(const std::filesystem::path& from, const std::filesystem::path& to) {
  std::error_code none;
  if (from != "-" && std::filesystem::equivalent(from, to, none)) {
    throw log::LogError{fmt::format("{}: would be read and written at once", to.string()), "give another name"};
  }
  const auto reader = log::open_log(from);
  const log::LogFormat format = log::format_by_name(to);
  const auto writer = log::create_log(log::create_file(to), format);
  log::LogEntry entry;
  while (reader->next(entry)) writer->write(entry, reader->channels()[entry.channel]);
  writer->finish();
  print_log_warnings(*reader, from);
  if (to != "-") fmt::print("{} frames: {}\n", reader->frames(), to.string());
  return ExitStatus::kHeld;
}

}  // namespace meltbench::cli
