#include "bench/record/run_recorder.hpp"

#include <fmt/compile.h>
#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <system_error>
#include <unordered_set>

#include "bench/record/block_file.hpp"
#include "bench/record/line_recorder.hpp"
#include "protocols/can/candump.hpp"

namespace meltbench::record {
namespace {

using Json = nlohmann::ordered_json;

/// One JSON object as one line. Text that is not UTF-8 is repaired instead of thrown at: a recorder does not stop.
void append_line(BlockFile& file, const Json& object) {
  file.text() += object.dump(-1, ' ', false, Json::error_handler_t::replace);
  file.text() += '\n';
  file.end_line();
}

/// Seconds with nine decimals, exact.
void append_time(std::string& out, Instant at) {
  const auto ns = at.since_start.count();
  fmt::format_to(std::back_inserter(out), FMT_COMPILE("{}.{:09}"), ns / 1'000'000'000, ns % 1'000'000'000);
}

void require_usable_names(const std::vector<SignalInfo>& signals) {
  std::unordered_set<std::string_view> seen;
  for (const SignalInfo& signal : signals) {
    if (signal.name.empty() || signal.name.find_first_of(",\"\r\n") != std::string::npos) {
      throw std::invalid_argument(
          fmt::format("signal name \"{}\": must not be empty or hold a comma, a quote or a line end", signal.name));
    }
    if (!seen.insert(signal.name).second) {
      throw std::invalid_argument(fmt::format("signal name \"{}\": given twice", signal.name));
    }
  }
}

Json describe_run(const Recording& recording) {
  const RunInfo& info = recording.info;
  Json counters = Json::array();
  for (const SignalInfo& signal : recording.signals) {
    if (signal.kind == SignalKind::kErrorCounter) counters.push_back(signal.name);
  }
  Json nodes = Json::object();
  for (const NodeName& node : info.nodes) nodes[node.name] = node.node_id;
  Json run{{"type", "run"},
           {"scenario", info.scenario},
           {"variant", info.variant},
           {"title", info.title},
           {"text", info.text},
           {"seed", info.seed},
           {"duration_ns", info.duration.count()},
           {"pace", info.pace},
           {"unseen", info.unseen},
           {"participants", info.participants},
           {"nodes", std::move(nodes)},
           {"bit_rate_bit_per_s", nullptr},
           {"version", info.version},
           {"repeat_command", info.repeat_command},
           {"error_counters", std::move(counters)}};
  if (info.bit_rate_bit_per_s) run["bit_rate_bit_per_s"] = *info.bit_rate_bit_per_s;
  return run;
}

/// Bucket numbers of LogHistogram with their counts; those that are empty are left out.
Json describe_wakeups(const WakeupTiming& timing) {
  const LogHistogram& lateness = timing.lateness;
  Json buckets = Json::array();
  for (std::size_t bucket = 0; bucket < LogHistogram::kBuckets; ++bucket) {
    if (lateness.in_bucket(bucket) > 0) buckets.push_back({bucket, lateness.in_bucket(bucket)});
  }
  return Json{{"participant", timing.participant},
              {"max_ns", lateness.max().count()},
              {"max_at_ns", lateness.max_at().since_start.count()},
              {"buckets", std::move(buckets)}};
}

Json describe_end(const Recording& recording) {
  const Ending& ending = recording.ending;
  Json end{{"type", "end"},
           {"t_s", to_s(ending.at)},
           {"reason", to_text(ending.reason)},
           {"text", ending.text},
           {"lost_frames", ending.lost_frames},
           {"real_time_factor", nullptr}};
  if (ending.real_time_factor) end["real_time_factor"] = *ending.real_time_factor;
  for (const WakeupTiming& timing : ending.wakeups) end["wakeups"].push_back(describe_wakeups(timing));
  if (recording.bus_timing) end["bus"] = *recording.bus_timing;
  return end;
}

std::string_view to_text(Severity severity) {
  switch (severity) {
    case Severity::kInfo:
      return "info";
    case Severity::kWarning:
      return "warning";
    case Severity::kFault:
      return "fault";
  }
  return "fault";
}

}  // namespace

/// The three open files, and the text of the last row: signals that stand still are not formatted again.
struct RunRecorder::Files {
  Files(const std::filesystem::path& folder, bool has_serial_lines)
      : bus{folder / "bus.log"}, signals{folder / "signals.csv"}, events{folder / "events.jsonl"} {
    if (has_serial_lines) serial.emplace(folder / "serial.log");
  }

  struct Cell {
    double value = 0;
    std::array<char, 31> text{'0'};
    std::uint8_t length = 1;
  };

  void append_cell(std::string& out, Cell& cell, double value) {
    if (std::memcmp(&cell.value, &value, sizeof value) != 0) {
      cell.value = value;
      const char* end = fmt::format_to(cell.text.data(), FMT_COMPILE("{}"), value);
      cell.length = static_cast<std::uint8_t>(end - cell.text.data());
    }
    out.append(cell.text.data(), cell.length);
  }

  BlockFile bus;
  BlockFile signals;
  BlockFile events;
  std::optional<BlockFile> serial;
  std::vector<Cell> cells;
};

RunRecorder::RunRecorder(RunInfo info, std::vector<SignalInfo> signals, const std::filesystem::path& folder) {
  require_usable_names(signals);
  recording_.info = std::move(info);
  recording_.signals = std::move(signals);
  if (folder.empty()) return;

  std::filesystem::create_directories(folder);
  // A verdict on an older run must not stand beside the recording of a new one.
  for (const char* stale : {"result.json", "junit.xml", "report.html", "serial.log"})
    std::filesystem::remove(folder / stale);
  files_ = std::make_unique<Files>(folder, recording_.info.has_serial_lines);
  files_->cells.resize(recording_.signals.size());

  std::string& header = files_->signals.text();
  header += "t_s";
  for (const SignalInfo& signal : recording_.signals) header.append(",").append(signal.name);
  header += '\n';
  append_line(files_->events, describe_run(recording_));
  flush();
}

RunRecorder::~RunRecorder() = default;

void RunRecorder::frame(const can::StampedFrame& stamped, std::uint8_t sender) {
  recording_.frames.push_back(stamped.at, stamped.frame, sender);
  if (!files_) return;
  can::append_log_line(files_->bus.text(), stamped.at, sender == kTapSender ? kTapDevice : kBenchDevice, stamped.frame);
  files_->bus.end_line();
}

void RunRecorder::serial(std::string_view line, std::string_view sender, Instant at,
                         std::span<const std::uint8_t> bytes) {
  if (!files_ || !files_->serial) return;
  append_serial_line(files_->serial->text(), at, line, sender, bytes);
  files_->serial->end_line();
}

void RunRecorder::row(Instant at, std::span<const double> values) {
  assert(values.size() == recording_.signals.size());
  recording_.row_times.push_back(at);
  recording_.values.insert(recording_.values.end(), values.begin(), values.end());
  if (!files_) return;
  std::string& line = files_->signals.text();
  append_time(line, at);
  for (std::size_t i = 0; i < values.size(); ++i) {
    line += ',';
    files_->append_cell(line, files_->cells[i], values[i]);
  }
  line += '\n';
  files_->signals.end_line();
}

void RunRecorder::event(std::string_view source, const Event& event) {
  recording_.events.push_back(RecordedEvent{std::string{source}, event});
  if (!files_) return;
  append_line(files_->events, Json{{"type", "event"},
                                   {"t_s", to_s(event.at)},
                                   {"source", source},
                                   {"severity", to_text(event.severity)},
                                   {"code", event.code},
                                   {"text", event.text}});
  files_->events.flush();
}

void RunRecorder::flush() {
  if (!files_) return;
  files_->bus.flush();
  files_->signals.flush();
  files_->events.flush();
  if (files_->serial) files_->serial->flush();
}

const Recording& RunRecorder::recording() const {
  return recording_;
}

Recording RunRecorder::finish(Ending ending) {
  recording_.ending = std::move(ending);
  if (files_) {
    files_->bus.flush();
    files_->signals.flush();
    if (files_->serial) files_->serial->flush();
    for (const BlockFile* file : {&files_->bus, &files_->signals, files_->serial ? &*files_->serial : nullptr}) {
      if (file == nullptr || file->error().empty()) continue;
      event("bench", Event{recording_.ending.at, Severity::kFault, "recording-failed", file->error()});
    }
    append_line(files_->events, describe_end(recording_));
    files_->events.flush();
    if (!files_->events.error().empty()) {
      recording_.events.push_back(
          {"bench", Event{recording_.ending.at, Severity::kFault, "recording-failed", files_->events.error()}});
    }
    files_.reset();
  }
  return std::move(recording_);
}

}  // namespace meltbench::record
