#include "bench/record/load_recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <utility>

#include "protocols/can/candump.hpp"

namespace meltbench::record {
namespace {

using Json = nlohmann::json;

constexpr const char* kHint = "a run folder is what \"meltbench run S.toml --out DIR\" leaves in DIR";

/// The lines of one file of a run folder, and where in it we are, for messages.
class Lines {
 public:
  Lines(const std::filesystem::path& path, std::vector<std::string>& notes) : path_{path.string()} {
    std::ifstream file{path, std::ios::binary};
    if (!file) throw LoadError(path_ + ": cannot be read", kHint);
    text_.assign(std::istreambuf_iterator<char>{file}, {});
    const std::size_t whole = text_.rfind('\n') + 1;  // npos + 1 = 0: not even one whole line.
    if (whole < text_.size()) {
      notes.push_back(path_ + ": the last line is torn and was dropped");
      text_.resize(whole);
    }
  }

  bool next(std::string_view& line) {
    if (begin_ >= text_.size()) return false;
    const std::size_t end = text_.find('\n', begin_);
    line = std::string_view{text_}.substr(begin_, end - begin_);
    begin_ = end + 1;
    ++number_;
    return true;
  }

  [[noreturn]] void fail(std::string_view why) const {
    throw LoadError(fmt::format("{}:{}: {}", path_, number_, why),
                    "this file was changed or damaged after the run; run the scenario again");
  }

 private:
  std::string path_;
  std::string text_;
  std::size_t begin_ = 0;
  std::size_t number_ = 0;
};

/// Text up to the next comma, and takes it off the line.
std::string_view take_cell(std::string_view& line) {
  const std::size_t comma = line.find(',');
  const std::string_view cell = line.substr(0, comma);
  line = comma == std::string_view::npos ? std::string_view{} : line.substr(comma + 1);
  return cell;
}

/// "12.340000000" to whole nanoseconds, without a detour over a double.
bool parse_time(std::string_view text, Instant& at) {
  const std::size_t dot = text.find('.');
  if (dot == std::string_view::npos || text.size() - dot != 10 || dot > 9) return false;
  std::int64_t seconds = 0;
  std::int64_t nanoseconds = 0;
  const char* const point = text.data() + dot;
  const char* const end = text.data() + text.size();
  if (std::from_chars(text.data(), point, seconds).ptr != point) return false;
  if (std::from_chars(point + 1, end, nanoseconds).ptr != end || nanoseconds < 0 || seconds < 0) return false;
  at = Instant{Nanos{seconds * 1'000'000'000 + nanoseconds}};
  return true;
}

bool parse_value(std::string_view text, double& value) {
  const char* const end = text.data() + text.size();
  const auto parsed = std::from_chars(text.data(), end, value);
  return parsed.ec == std::errc{} && parsed.ptr == end;
}

void read_signals(const std::filesystem::path& path, Recording& recording) {
  Lines lines{path, recording.notes};
  std::string_view line;
  if (!lines.next(line)) lines.fail("has no header line");
  if (take_cell(line) != "t_s") lines.fail("the first column must be t_s");
  while (!line.empty()) recording.signals.push_back(SignalInfo{std::string{take_cell(line)}, SignalKind::kValue});

  while (lines.next(line)) {
    Instant at;
    if (!parse_time(take_cell(line), at)) lines.fail("the time is not seconds with nine decimals");
    if (!recording.row_times.empty() && at < recording.row_times.back()) lines.fail("time runs backwards");
    for (const SignalInfo& signal : recording.signals) {
      double value = 0;
      if (!parse_value(take_cell(line), value)) lines.fail(fmt::format("the value of {} is not a number", signal.name));
      recording.values.push_back(value);
    }
    if (!line.empty()) lines.fail("more values than names in the header");
    recording.row_times.push_back(at);
  }
}

void read_bus(const std::filesystem::path& path, Recording& recording) {
  Lines lines{path, recording.notes};
  std::string_view line;
  while (lines.next(line)) {
    const can::ParsedLogLine parsed = can::parse_log_line(line);
    if (parsed.kind == can::LogLineKind::kComment) continue;
    if (parsed.kind == can::LogLineKind::kBad) lines.fail(parsed.complaint);
    recording.frames.push_back(parsed.line.at, parsed.line.frame,
                               parsed.line.device == kTapDevice ? kTapSender : kUnknownSender);
  }
}

void read_run(const Json& run, Recording& recording, std::vector<std::string>& error_counters) {
  RunInfo& info = recording.info;
  run.at("scenario").get_to(info.scenario);
  run.at("variant").get_to(info.variant);
  run.at("title").get_to(info.title);
  run.at("text").get_to(info.text);
  run.at("seed").get_to(info.seed);
  info.duration = Nanos{run.at("duration_ns").get<std::int64_t>()};
  run.at("pace").get_to(info.pace);
  run.at("unseen").get_to(info.unseen);
  run.at("participants").get_to(info.participants);
  for (const auto& [name, id] : run.at("nodes").items()) info.nodes.push_back({id.get<std::uint8_t>(), name});
  std::sort(info.nodes.begin(), info.nodes.end(), [](auto& a, auto& b) { return a.node_id < b.node_id; });
  if (const Json& rate = run.at("bit_rate_bit_per_s"); !rate.is_null())
    info.bit_rate_bit_per_s = rate.get<std::uint32_t>();
  run.at("version").get_to(info.version);
  run.at("repeat_command").get_to(info.repeat_command);
  run.at("error_counters").get_to(error_counters);
}

Severity read_severity(const Json& text) {
  if (text == "info") return Severity::kInfo;
  return text == "warning" ? Severity::kWarning : Severity::kFault;
}

EndReason read_reason(const Json& text) {
  for (const EndReason reason : {EndReason::kCompleted, EndReason::kInterrupted, EndReason::kParticipantLost}) {
    if (text == to_text(reason)) return reason;
  }
  return EndReason::kCutShort;
}

WakeupTiming read_wakeups(const Json& object) {
  WakeupTiming timing{object.at("participant").get<std::string>(), {}};
  for (const Json& bucket : object.at("buckets")) {
    const auto index = bucket.at(0).get<std::size_t>();
    if (index < LogHistogram::kBuckets) timing.lateness.add_bucket(index, bucket.at(1).get<std::uint64_t>());
  }
  timing.lateness.set_max(Nanos{object.at("max_ns").get<Nanos::rep>()},
                          Instant{Nanos{object.at("max_at_ns").get<Nanos::rep>()}});
  return timing;
}

Ending read_end(const Json& end) {
  Ending ending;
  ending.at = Instant{nanos_from_s(end.at("t_s").get<double>())};
  ending.reason = read_reason(end.at("reason"));
  end.at("text").get_to(ending.text);
  end.at("lost_frames").get_to(ending.lost_frames);
  if (const Json& factor = end.at("real_time_factor"); !factor.is_null())
    ending.real_time_factor = factor.get<double>();
  for (const Json& timing : end.value("wakeups", Json::array())) ending.wakeups.push_back(read_wakeups(timing));
  return ending;
}

/// Reads events.jsonl. @returns whether it has an end record.
bool read_events(const std::filesystem::path& path, Recording& recording, std::vector<std::string>& error_counters) {
  Lines lines{path, recording.notes};
  bool has_run = false;
  bool has_end = false;
  std::string_view line;
  while (lines.next(line)) try {
      const Json object = Json::parse(line);
      const std::string type = object.at("type").get<std::string>();
      if (type == "run") {
        read_run(object, recording, error_counters);
        has_run = true;
      } else if (type == "end") {
        recording.ending = read_end(object);
        if (object.contains("bus")) recording.bus_timing = object.at("bus").get<BusTiming>();
        has_end = true;
      } else if (type == "event") {
        recording.events.push_back(
            {object.at("source").get<std::string>(),
             Event{Instant{nanos_from_s(object.at("t_s").get<double>())}, read_severity(object.at("severity")),
                   object.at("code").get<std::string>(), object.at("text").get<std::string>()}});
      } else {
        lines.fail(fmt::format("\"{}\" is no type of record", type));
      }
    } catch (const Json::exception& error) {
      lines.fail(error.what());
    }
  if (!has_run) lines.fail("has no \"run\" record");
  return has_end;
}

/// How a run without an end record ended, as far as one can tell.
Ending guess_ending(const Recording& recording) {
  Ending ending;
  ending.reason = EndReason::kCutShort;
  ending.text = "the bench itself was ended before the run was over";
  if (!recording.row_times.empty()) ending.at = recording.row_times.back();
  if (!recording.frames.empty()) ending.at = std::max(ending.at, recording.frames.at(recording.frames.size() - 1));
  if (!recording.events.empty()) ending.at = std::max(ending.at, recording.events.back().event.at);
  return ending;
}

}  // namespace

Recording load_recording(const std::filesystem::path& folder) {
  Recording recording;
  std::vector<std::string> error_counters;
  const bool has_end = read_events(folder / "events.jsonl", recording, error_counters);
  read_signals(folder / "signals.csv", recording);
  read_bus(folder / "bus.log", recording);
  for (const std::string& name : error_counters) {
    if (const auto column = recording.find_signal(name)) recording.signals[*column].kind = SignalKind::kErrorCounter;
  }
  if (!has_end) {
    recording.ending = guess_ending(recording);
    recording.notes.push_back((folder / "events.jsonl").string() + ": has no end record: the run was cut short");
  }
  return recording;
}

std::string read_scenario_name(const std::filesystem::path& folder) {
  std::ifstream file{folder / "events.jsonl", std::ios::binary};
  std::string line;
  std::getline(file, line);
  const Json run = Json::parse(line, nullptr, false);
  if (!run.is_object() || run.value("type", "") != "run") return {};
  return run.value("scenario", "");
}

void remove_run(const std::filesystem::path& folder) {
  for (const char* ours : {"bus.log", "serial.log", "signals.csv", "events.jsonl", "result.json", "junit.xml",
                           "report.html", "repro.toml"}) {
    std::filesystem::remove(folder / ours);
  }
  std::error_code not_empty;
  std::filesystem::remove(folder, not_empty);
}

}  // namespace meltbench::record
