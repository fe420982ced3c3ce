#include "bench/cli/recorded_log.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "bench/log/log_error.hpp"

namespace meltbench::cli {
namespace {

/// No run is as long; a log whose first stamp is larger has the date in it.
constexpr Nanos kDate = 365 * 86'400s;

}  // namespace

std::filesystem::path find_log(const std::filesystem::path& path) {
  const std::filesystem::path log = std::filesystem::is_directory(path) ? path / "bus.log" : path;
  if (log != "-" && !std::filesystem::exists(log)) {
    throw log::LogError{fmt::format("{}: No such file or directory", log.string()),
                        "name a log (candump, ASC, BLF, gzip), or the folder of a run, which has a bus.log"};
  }
  return log;
}

std::filesystem::path find_serial_log(const std::filesystem::path& log) {
  std::filesystem::path name = log.filename();
  if (name.extension() == ".gz") name.replace_extension();
  const std::string stem = name.stem().string() + ".serial";
  for (const std::string& beside : {stem + ".log", stem + ".log.gz", stem + ".gz", std::string{"serial.log"}}) {
    if (std::filesystem::exists(log.parent_path() / beside)) return log.parent_path() / beside;
  }
  return {};
}

void read_serial_log(const std::filesystem::path& path, Instant zero,
                     const std::function<void(Instant at, const log::SerialEntry& entry)>& take) {
  const std::unique_ptr<log::ByteSource> source = log::open_file(path);
  log::SerialLogReader reader{*source};
  log::SerialEntry entry;
  while (reader.next(entry)) take(entry.at >= zero ? Instant{entry.at - zero} : entry.at, entry);
}

scenario::ResolvedRun load_run_of(const std::filesystem::path& scenario, const std::filesystem::path& log) {
  const auto file = scenario.empty() ? log.parent_path() / "repro.toml" : scenario;
  if (scenario.empty() && !std::filesystem::exists(file)) {
    throw std::invalid_argument{
        fmt::format("{} is not there: say with --scenario which rig and settings the log is of", file.string())};
  }
  std::vector<scenario::ResolvedRun> runs = scenario::load(file);
  if (runs.size() > 1) throw std::invalid_argument{"the scenario has variants: give the repro.toml of one"};
  return std::move(runs.front());
}

ChannelLog::ChannelLog(const std::filesystem::path& log, std::string channel)
    : reader_{log::open_log(log)}, channel_{std::move(channel)} {}

bool ChannelLog::next(log::LogEntry& entry) {
  while (reader_->next(entry)) {
    if (!channel_.takes(*reader_, entry)) continue;
    if (!begun_ && entry.at.since_start > kDate) zero_ = entry.at;
    begun_ = true;
    entry.at = Instant{entry.at - zero_};
    return true;
  }
  channel_.check_found(*reader_);
  return false;
}

void ChannelLog::warn_of_other_channels() const {
  if (reader_->channels().size() < 2) return;
  fmt::print(stderr, "warning: of the channels {} only {} was looked at; --channel takes another\n",
             fmt::join(reader_->channels(), ", "), channel_.name());
}

}  // namespace meltbench::cli
