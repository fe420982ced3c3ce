#include "bench/cli/replay_command.hpp"

#include <fmt/format.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <memory>
#include <stdexcept>
#include <utility>

#include "bench/bus/virtual_time.hpp"
#include "bench/cli/log_commands.hpp"
#include "bench/cli/recorded_log.hpp"
#include "bench/cli/replay_plots.hpp"
#include "bench/cli/version.hpp"
#include "bench/log/log_error.hpp"
#include "bench/log/log_writer.hpp"
#include "bench/replay/fits.hpp"
#include "bench/replay/log_partner.hpp"
#include "bench/replay/raw_replay.hpp"
#include "bench/report/replay_page.hpp"
#include "bench/report/whole_file.hpp"
#include "controller/machine/controller.hpp"
#include "plant_emulator/emulator.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/participant_port.hpp"
#include "protocols/runtime/real_time_driver.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

std::optional<std::uint32_t> parse_id(std::string_view text) {
  std::uint32_t id = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, id, 16);
  if (text.empty() || stop != end || error != std::errc{}) return std::nullopt;
  return id;
}

/// "ID<separator>ID", both hexadecimal.
std::optional<std::pair<std::uint32_t, std::uint32_t>> parse_id_pair(std::string_view text, char separator) {
  const std::size_t at = text.find(separator);
  if (at == std::string_view::npos) return std::nullopt;
  const auto first = parse_id(text.substr(0, at));
  const auto second = parse_id(text.substr(at + 1));
  if (!first || !second) return std::nullopt;
  return std::pair{*first, *second};
}

replay::RawReplayRequest to_raw_request(const ReplayRequest& request) {
  replay::RawReplayRequest raw{request.speed, request.loops, request.channel, {}, {}};
  for (const std::string& text : request.only) {
    if (const auto id = parse_id(text)) {
      raw.only.push_back({*id, 0xFFFF'FFFF});
    } else if (const auto pair = parse_id_pair(text, '/')) {
      raw.only.push_back({pair->first, pair->second});
    } else {
      throw std::invalid_argument{fmt::format("--only {}: expected ID or ID/MASK in hexadecimal", text)};
    }
  }
  for (const std::string& text : request.renames) {
    const auto pair = parse_id_pair(text, '=');
    if (!pair || pair->second > can::kMaxExtendedId) {
      throw std::invalid_argument{fmt::format("--rename {}: expected OLD=NEW in hexadecimal", text)};
    }
    raw.renames.push_back({pair->first, pair->second});
  }
  return raw;
}

/// @throws std::invalid_argument for the embedded bus of a run.
link::BusUri parse_outer_bus(const std::string& can) {
  link::BusUri uri = link::parse_bus_uri(can);
  if (uri.kind != link::BusUri::Kind::kSocketCan && uri.kind != link::BusUri::Kind::kSlcan) {
    throw std::invalid_argument{
        "--can needs a kernel interface such as can0, or slcan:PORT; to a controller or boards of ours: --to"};
  }
  return uri;
}

ExitStatus replay_onto_bus(const ReplayRequest& request) {
  const link::BusUri uri = parse_outer_bus(request.can);
  const replay::RawReplayRequest raw = to_raw_request(request);
  const std::filesystem::path path = find_log(request.log);
  const auto bus = link::open_can_link(uri);
  runtime::catch_stop_signals();
  const replay::RawReplayResult result =
      replay::replay_raw([&path] { return log::open_log(path); }, *bus, raw, [] { return runtime::stop_requested(); });
  fmt::print("{} frames sent on {}, {} left out, {} not for this bus; transmit queue full {} times\n", result.sent,
             uri.name, result.left_out, result.unsupported, result.waits);
  if (result.refused > 0) fmt::print("{} of them refused by the adapter\n", result.refused);
  fmt::print("behind the recorded times: p50 {:.1f} us, p99 {:.1f} us, max {:.1f} us\n",
             to_s(result.lateness.quantile(0.5)) * 1e6, to_s(result.lateness.quantile(0.99)) * 1e6,
             to_s(result.lateness.max()) * 1e6);
  return ExitStatus::kHeld;
}

// --- to a live side

/// "feeder.6130:1=0.01" for each object that may differ.
replay::Tolerance read_tolerance(const ReplayRequest& request, const config::Rig& rig) {
  replay::Tolerance tolerance;
  tolerance.time = Nanos{static_cast<std::int64_t>(request.time_tolerance_ms * 1e6)};
  for (const std::string& text : request.value_tolerances) {
    const std::size_t dot = text.find('.');
    const std::size_t colon = text.find(':');
    const std::size_t equals = text.find('=');
    const auto bad = [&text](std::string_view why) {
      return std::invalid_argument{fmt::format("--tolerance {}: {}, e.g. feeder.6130:1=0.01", text, why)};
    };
    if (dot > colon || colon > equals || equals == std::string::npos) throw bad("expected BOARD.INDEX:SUB=VALUE");
    const auto board = std::ranges::find(rig.boards, text.substr(0, dot), &config::RigBoard::name);
    if (board == rig.boards.end()) throw bad("the rig has no such board");
    const auto index = parse_id(std::string_view{text}.substr(dot + 1, colon - dot - 1));
    const auto sub = parse_id(std::string_view{text}.substr(colon + 1, equals - colon - 1));
    double value = 0.0;
    const char* end = text.data() + text.size();
    const auto [stop, error] = std::from_chars(text.data() + equals + 1, end, value);
    if (!index || !sub || stop != end || error != std::errc{} || !(value >= 0.0))
      throw bad("that is no object or value");
    tolerance.values[{board->node_id, {static_cast<std::uint16_t>(*index), static_cast<std::uint8_t>(*sub)}}] = value;
  }
  return tolerance;
}

/// Writes what was said in the replay, if somebody wants it.
class Witness final : public bus::RunObserver {
 public:
  explicit Witness(const std::filesystem::path& path) {
    if (path.empty()) return;
    const log::LogFormat format = log::format_by_name(path);
    writer_ = log::create_log(log::create_file(path), format);
  }
  void on_frame(const can::StampedFrame& frame, std::size_t) override {
    if (writer_) writer_->write({frame.at, 0, log::Direction::kUnknown, frame.frame}, "bench");
  }
  void on_row(Instant, std::span<const double>) override {}
  void on_event(std::size_t, const Event& event) override {
    if (event.severity == Severity::kFault) faults_.push_back(fmt::format("{:.6f} s  {}", to_s(event.at), event.text));
  }
  void finish() {
    if (writer_) writer_->finish();
  }
  [[nodiscard]] const std::vector<std::string>& faults() const { return faults_; }

 private:
  std::unique_ptr<log::LogWriter> writer_;
  std::vector<std::string> faults_;
};

std::string_view text(replay::Difference::Kind kind) {
  switch (kind) {
    case replay::Difference::Kind::kMissing:
      return "missing";
    case replay::Difference::Kind::kUnexpected:
      return "unexpected";
    case replay::Difference::Kind::kChanged:
      return "changed";
    case replay::Difference::Kind::kEarly:
      return "early";
    case replay::Difference::Kind::kLate:
      return "late";
  }
  return "?";
}

void print_differences(const replay::Comparison& comparison, const std::filesystem::path& path) {
  for (const replay::Difference& difference : comparison.differences()) {
    const std::string place =
        difference.line == 0 ? std::string{"now"} : fmt::format("{}:{}", path.string(), difference.line);
    fmt::print("  {:12.6f} s  {:<10} {}  ({})\n", to_s(difference.at), text(difference.kind), difference.text, place);
  }
  if (comparison.count() > comparison.differences().size()) {
    fmt::print("  and {} more\n", comparison.count() - comparison.differences().size());
  }
}

/// Ours, in virtual time. @returns how far it came.
Instant play_to_ours(const scenario::ResolvedRun& run, bool to_controller, Instant end, Participant& partner,
                     bus::RunObserver& witness) {
  std::unique_ptr<Participant> live;
  if (to_controller) {
    live = std::make_unique<machine::Controller>(machine::read_settings(run.root));
  } else {
    live = std::make_unique<emulator::Emulator>(emulator::read_settings(run.root, run.rig), run.seed);
  }
  runtime::InProcessPort live_port{*live};
  runtime::InProcessPort log_port{partner};
  // The controller goes first at an instant, as in a run.
  const auto ports = to_controller ? std::array<runtime::ParticipantPort*, 2>{&live_port, &log_port}
                                   : std::array<runtime::ParticipantPort*, 2>{&log_port, &live_port};
  const bus::RunMedia media{.lines = run.rig.lines};
  return bus::VirtualTime{ports, run.record_period, witness, media}.run(end.since_start).at;
}

/// A bus whose first frame has been read already, and is given again.
class FromFirstFrame final : public link::CanLink {
 public:
  /// Waits for a frame, or for a stop.
  explicit FromFirstFrame(link::CanLink& bus) : bus_{bus} {
    while (!first_ && !runtime::stop_requested()) {
      pollfd watched{bus_.is_up() ? bus_.fd() : -1, POLLIN, 0};
      static_cast<void>(::poll(&watched, 1, 100));
      first_ = bus_.receive();
    }
  }
  /// On CLOCK_MONOTONIC, when it came; now if there is none.
  [[nodiscard]] Nanos begin() const { return first_ ? first_->at_monotonic : runtime::read_monotonic(); }

  link::SendStatus send(const can::CanFrame& frame) noexcept override { return bus_.send(frame); }
  std::optional<link::ReceivedFrame> receive() noexcept override {
    return first_ ? std::exchange(first_, std::nullopt) : bus_.receive();
  }
  bool is_up() noexcept override { return bus_.is_up(); }
  int fd() const noexcept override { return bus_.fd(); }
  const link::LinkCounters& counters() const noexcept override { return bus_.counters(); }

 private:
  link::CanLink& bus_;
  std::optional<link::ReceivedFrame> first_;
};

/// @returns how far it came.
Instant play_on(link::CanLink& bus, Nanos begin, Instant end, Participant& partner) {
  const link::Welcome timing{link::Pace::kWallClock, 1.0, begin, 100ms};
  static_cast<void>(runtime::RealTimeDriver{partner, bus, nullptr, timing}.run(end));
  return std::min(end, Instant{runtime::read_monotonic() - begin});
}

/// Somebody else's on a bus, at wall-clock pace. A recording begins with the controller's first frame: that of an
/// external controller is waited for. @returns how far it came.
Instant play_to_external(const std::string& can, bool to_controller, Instant end, Participant& partner) {
  const auto bus = link::open_can_link(parse_outer_bus(can));
  if (!to_controller) return play_on(*bus, runtime::read_monotonic(), end, partner);
  fmt::print(stderr, "waiting for the controller's first frame on {}; start it now\n", can);
  FromFirstFrame from_first{*bus};
  return play_on(from_first, from_first.begin(), end, partner);
}

std::vector<report::ReplayFit> list_fits(const replay::Fits& fits, const decode::BusView& view) {
  std::vector<report::ReplayFit> list;
  for (const auto& [key, fit] : fits.signals()) {
    const auto [name, unit] = split_unit(fit.name);
    list.push_back({view.name_of(key.first), text(key.second), name, unit, fit.compared, fit.differing, fit.largest,
                    fit.rms(), to_s(fit.at), fit.line});
  }
  return list;
}

/// How well each signal was met. @param all  also those that were met exactly.
void print_fits(const std::vector<report::ReplayFit>& fits, const std::filesystem::path& path, bool all) {
  const auto name_of = [](const report::ReplayFit& fit) {
    return fmt::format("{} {}, {}", fit.board, fit.object, fit.name);
  };
  std::size_t width = 0;
  for (const report::ReplayFit& fit : fits) {
    if (all || fit.differing > 0) width = std::max(width, name_of(fit).size());
  }
  if (width == 0) return;
  fmt::print("fit of each signal{}\n  {:<{}}  {:<12} {:>9} {:>8} {:>10} {:>10}  largest at\n",
             all ? "" : " that differs", "", width, "unit", "compared", "differ", "largest", "rms");
  for (const report::ReplayFit& fit : fits) {
    if (!all && fit.differing == 0) continue;
    const std::string where =
        fit.differing == 0 ? "" : fmt::format("  {:.6f} s  ({}:{})", fit.at_s, path.string(), fit.line);
    fmt::print("  {:<{}}  {:<12} {:>9} {:>8} {:>10.4g} {:>10.4g}{}\n", name_of(fit), width, fit.unit, fit.compared,
               fit.differing, fit.largest, fit.rms, where);
  }
}

void write_page(const ReplayRequest& request, const replay::Comparison& comparison, report::ReplayPage page) {
  page.title = fmt::format("Replayed to the {}: {}", request.to, request.log.string());
  page.count = comparison.count();
  for (const replay::Difference& difference : comparison.differences()) {
    page.differences.push_back({to_s(difference.at), std::string{text(difference.kind)}, difference.text,
                                difference.line == 0 ? "now" : fmt::format("line {}", difference.line)});
  }
  page.version = std::string{kProgramVersion};
  report::write_whole_file(request.html, report::render_replay_page(std::move(page)));
  fmt::print("{}\n", request.html.string());
}

ExitStatus replay_to_live_side(const ReplayRequest& request) {
  const bool to_controller = request.to == "controller";
  if (!to_controller && request.to != "boards") throw std::invalid_argument{"--to controller, or --to boards"};
  const std::filesystem::path path = find_log(request.log);
  const scenario::ResolvedRun run = load_run_of(request.scenario, path);
  const auto reader = log::open_log(path);
  decode::BusView of_log{run.rig};
  const replay::Script script = replay::read_script(*reader, of_log, request.channel);
  print_log_warnings(*reader, path);

  decode::BusView view{run.rig};
  replay::Comparison comparison{view, read_tolerance(request, run.rig)};
  replay::Fits fits;
  ReplayPlots plots;
  comparison.watch([&](const replay::ValuePair& pair) {
    fits.take(pair);
    if (!request.html.empty()) plots.take(pair);
  });
  replay::LogPartner partner{script, to_controller ? replay::LiveSide::kController : replay::LiveSide::kBoards,
                             comparison};
  Witness witness{request.update_reference};
  runtime::catch_stop_signals();
  const Instant reached = request.can.empty() ? play_to_ours(run, to_controller, script.end, partner, witness)
                                              : play_to_external(request.can, to_controller, script.end, partner);
  comparison.finish(script.end);
  witness.finish();
  const std::string summary =
      fmt::format("{} s replayed to the {}: {} answers compared, {} differ; largest shift {:.3f} ms", to_s(reached),
                  request.to, comparison.compared(), comparison.count(), to_s(comparison.worst_shift()) * 1e3);
  fmt::print("{} of {}\n", path.string(), summary);
  print_differences(comparison, path);
  std::vector<report::ReplayFit> list = list_fits(fits, view);
  print_fits(list, path, !to_controller);
  for (const std::string& fault : witness.faults()) fmt::print("  fault in the replay: {}\n", fault);
  if (!request.update_reference.empty()) fmt::print("new reference: {}\n", request.update_reference.string());
  if (!request.html.empty()) {
    report::ReplayPage page;
    page.summary = summary;
    page.fits = std::move(list);
    page.plots = plots.finish(fits, view);
    page.signals_left_out = plots.left_out();
    write_page(request, comparison, std::move(page));
  }
  return comparison.count() == 0 ? ExitStatus::kHeld : ExitStatus::kFailed;
}

}  // namespace

ExitStatus replay_log(const ReplayRequest& request) {
  if (request.can.empty() && request.to.empty()) {
    throw std::invalid_argument{"replay needs one of --can BUS, --to controller, --to boards"};
  }
  if (!(request.speed > 0.0)) throw std::invalid_argument{"--speed must be above 0"};
  if (!(request.time_tolerance_ms > 0.0)) throw std::invalid_argument{"--time-tolerance must be above 0 ms"};
  return request.to.empty() ? replay_onto_bus(request) : replay_to_live_side(request);
}

}  // namespace meltbench::cli
