#include "bench/cli/show_command.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <numeric>
#include <optional>
#include <span>

#include "bench/cli/log_commands.hpp"
#include "bench/cli/log_page_maker.hpp"
#include "bench/cli/recorded_log.hpp"
#include "bench/cli/version.hpp"
#include "bench/decode/line_story.hpp"
#include "bench/decode/story.hpp"
#include "bench/report/whole_file.hpp"
#include "protocols/config/toml.hpp"

namespace meltbench::cli {
namespace {

constexpr std::size_t kLoadsInALine = 10;
constexpr std::size_t kMostLoads = 300;

void print_frames(ChannelLog& log, const config::Rig& rig, const decode::Dbc& dbc) {
  decode::BusView view{rig, &dbc};
  log::LogEntry entry;
  while (log.next(entry)) {
    view.take(entry.frame);
    fmt::print("{:14.6f}  {}\n", to_s(entry.at), view.describe(entry.frame));
  }
}

/// A night's log is not to be a thousand lines of load.
std::size_t choose_load_span_s(std::size_t seconds) {
  std::size_t span_s = 1;
  for (const std::size_t step : {10U, 6U, 10U, 6U, 24U}) {  // 10 s, 1 min, 10 min, 1 h, 1 day
    if (seconds <= kMostLoads * span_s) break;
    span_s *= step;
  }
  return span_s;
}

void print_load(const decode::Load& load) {
  if (load.per_second.empty()) return;
  const auto [least, most] = std::ranges::minmax(load.per_second);
  fmt::print("load per second: min {:.1f} %, mean {:.1f} %, max {:.1f} %\n", 100.0F * least, 100.0 * load.mean,
             100.0F * most);
  const std::size_t span_s = choose_load_span_s(load.per_second.size());
  if (span_s > 1) fmt::print("means of {} s each:\n", span_s);
  for (std::size_t first = 0; first < load.per_second.size(); first += span_s) {
    if (first % (kLoadsInALine * span_s) == 0) fmt::print("{}{:8} s ", first == 0 ? "" : "\n", first);
    const std::span seconds = std::span{load.per_second}.subspan(first);
    const std::span span = seconds.first(std::min(span_s, seconds.size()));
    const float sum = std::accumulate(span.begin(), span.end(), 0.0F);
    fmt::print(" {:5.1f}", 100.0F * sum / static_cast<float>(span.size()));
  }
  fmt::print("\n");
}

/// What the serial lines tell; nothing without a serial log.
std::optional<decode::LineStory> read_lines(const std::filesystem::path& serial, const config::Rig& rig, Instant zero,
                                            Instant end) {
  if (serial.empty()) return std::nullopt;
  decode::LineStory lines{rig};
  read_serial_log(serial, zero,
                  [&](Instant at, const log::SerialEntry& entry) { lines.take(at, entry.line, entry.bytes); });
  lines.finish(end);
  return lines;
}

void print_story(ChannelLog& log, const config::Rig& rig, const decode::Dbc& dbc, const std::filesystem::path& serial) {
  decode::Story story{rig, &dbc};
  log::LogEntry entry;
  while (log.next(entry)) story.take(entry.at, entry.frame);
  story.finish();
  if (log.zero() > Instant{}) {
    fmt::print("0 s is {:%Y-%m-%d %H:%M:%S} UTC\n", fmt::gmtime(log.zero().since_start / 1s));
  }
  std::vector<std::pair<Instant, std::string_view>> lines;
  for (const decode::Finding& finding : story.findings()) lines.emplace_back(finding.at, finding.text);
  std::uint64_t left_out = story.left_out();
  const auto of_lines = read_lines(serial, rig, log.zero(), story.end());
  if (of_lines) {
    for (const decode::LineFinding& finding : of_lines->findings()) lines.emplace_back(finding.at, finding.text);
    left_out += of_lines->left_out();
  }
  std::ranges::stable_sort(lines, {}, &std::pair<Instant, std::string_view>::first);
  for (const auto& [at, text] : lines) fmt::print("{:14.6f}  {}\n", to_s(at), text);
  if (left_out > 0) fmt::print("and {} more\n", left_out);
  fmt::print("{} frames in {:.6f} s\n", story.frames(), to_s(story.end()));
  if (rig.boards.empty()) fmt::print("no rig says the bit rate: load as of {} bit/s\n", rig.bus.bit_rate_bit_per_s);
  print_load(story.load());
}

void write_page(ChannelLog& log, const config::Rig& rig, const decode::Dbc& dbc, const std::filesystem::path& path,
                const std::filesystem::path& serial, const std::filesystem::path& html) {
  LogPageMaker maker{rig, &dbc};
  log::LogEntry entry;
  while (log.next(entry)) maker.take(entry.at, entry.frame);
  if (const auto lines = read_lines(serial, rig, log.zero(), maker.end())) maker.add(*lines);
  report::LogPage page = maker.finish();
  // Every run's is called bus.log: its folder says which one.
  const std::filesystem::path name =
      path.filename() == "bus.log" ? path.parent_path().filename() / path.filename() : path.filename();
  page.title = fmt::format("What happened on the bus: {}", name.string());
  page.version = std::string{kProgramVersion};
  page.facts.emplace(page.facts.begin(), "log", path.string());
  if (log.zero() > Instant{}) {
    const auto begun = fmt::format("{:%Y-%m-%d %H:%M:%S} UTC", fmt::gmtime(log.zero().since_start / 1s));
    page.facts.emplace(page.facts.begin() + 1, "0 s is", begun);
  }
  if (!serial.empty()) page.facts.emplace_back("serial lines", serial.string());
  report::write_whole_file(html, report::render_log_page(std::move(page)));
  fmt::print("{}\n", html.string());
}

/// The rig that the log is of. A DBC does without: no board then.
config::Rig find_rig(const ShowRequest& request, const std::filesystem::path& log) {
  const bool has_scenario = !request.scenario.empty() || std::filesystem::exists(log.parent_path() / "repro.toml");
  return request.dbc.empty() || has_scenario ? load_run_of(request.scenario, log).rig : config::Rig{};
}

}  // namespace

ExitStatus show_log(const ShowRequest& request) {
  const std::filesystem::path path = find_log(request.log);
  const config::Rig rig = find_rig(request, path);
  const decode::Dbc dbc =
      request.dbc.empty() ? decode::Dbc{} : decode::read_dbc(config::read_text_file(request.dbc), request.dbc.string());
  const std::filesystem::path serial = request.serial.empty() ? find_serial_log(path) : request.serial;
  ChannelLog log{path, request.channel};
  if (!request.html.empty()) {
    write_page(log, rig, dbc, path, serial, request.html);
  } else if (request.frames) {
    print_frames(log, rig, dbc);
  } else {
    print_story(log, rig, dbc, serial);
  }
  print_log_warnings(log.reader(), path);
  log.warn_of_other_channels();
  return ExitStatus::kHeld;
}

}  // namespace meltbench::cli
