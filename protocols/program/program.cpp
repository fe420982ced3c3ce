#include "protocols/program/program.hpp"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <exception>
#include <memory>
#include <optional>
#include <span>

#include "protocols/config/line_ports.hpp"
#include "protocols/config/toml.hpp"
#include "protocols/runtime/bench_client.hpp"
#include "protocols/runtime/lockstep_driver.hpp"
#include "protocols/runtime/real_time_driver.hpp"
#include "protocols/runtime/real_time_process.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::program {
namespace {

constexpr int kExitOk = 0;
constexpr int kExitBadInput = 2;
constexpr int kExitLost = 3;

runtime::Hello introduce(const Participant& participant, bool carries_frames) {
  runtime::Hello hello{std::string{participant.name()}, carries_frames, {}, {}, {}};
  hello.signals.assign(participant.signals().begin(), participant.signals().end());
  hello.nodes.assign(participant.nodes().begin(), participant.nodes().end());
  hello.lines.assign(participant.lines().begin(), participant.lines().end());
  return hello;
}

int to_exit_status(runtime::DriverEnd end) {
  return end == runtime::DriverEnd::kStopped ? kExitOk : kExitLost;
}

/// The ports of this machine that a program speaks on, opened.
class OwnPorts {
 public:
  OwnPorts(const Participant& participant, std::span<const serial::LinePort> lines) : participant_{participant} {
    for (const serial::LinePort& line : lines) {
      if (std::ranges::find(participant.lines(), line.line) == participant.lines().end()) {
        throw link::LinkError{fmt::format("{} does not speak on serial line {}", participant.name(), line.line),
                              "leave its --line away, or see the boards of the rig"};
      }
      ports_.push_back(std::make_unique<link::SerialPort>(line.port, line.settings));
      names_.push_back(line.line);
    }
  }

  /// All lines of the participant: its ports, and by way of the bench those that are none.
  /// @throws link::LinkError naming a line that has neither.
  [[nodiscard]] runtime::SerialPorts with_bench(runtime::BenchClient* bench) const {
    std::vector<link::SerialLink*> links;
    for (const std::string& name : participant_.lines()) {
      const auto found = std::ranges::find(names_, name);
      if (found == names_.end() && bench == nullptr) {
        throw link::LinkError{
            fmt::format("serial line {} has no port", name),
            fmt::format("--line {0}=/dev/ttyS1, or --line {0}=pty:/run/{0} for a pseudo-terminal", name)};
      }
      links.push_back(found == names_.end() ? static_cast<link::SerialLink*>(&bench->line(links.size()))
                                            : ports_[static_cast<std::size_t>(found - names_.begin())].get());
    }
    return {participant_.lines(), links};
  }
  [[nodiscard]] bool empty() const { return ports_.empty(); }

 private:
  const Participant& participant_;
  std::vector<std::string> names_;
  std::vector<std::unique_ptr<link::SerialPort>> ports_;
};

int run_on_embedded_bus(Participant& participant, const std::string& bus_name, const OwnPorts& ports) {
  auto joined = runtime::join_bench(introduce(participant, true), bus_name);
  if (!joined) return runtime::stop_requested() ? kExitOk : kExitLost;
  if (joined->welcome.pace == link::Pace::kLockstep) {
    if (!ports.empty())
      throw link::LinkError{"a serial port has no virtual time", "run the bench with --pace realtime"};
    return to_exit_status(runtime::run_lockstep(participant, joined->socket));
  }
  runtime::BenchClient bus{std::move(joined->socket), participant.lines().size()};
  return to_exit_status(runtime::RealTimeDriver{participant, bus, &bus, joined->welcome, ports.with_bench(&bus)}.run());
}

/// @param bench  name of an embedded bus to report to; empty: none.
int run_on_own_bus(Participant& participant, link::CanLink& can, const std::string& bench, const OwnPorts& ports) {
  if (bench.empty()) {
    link::Welcome timing{link::Pace::kWallClock, 1.0, runtime::read_monotonic(), 10ms};
    return to_exit_status(runtime::RealTimeDriver{participant, can, nullptr, timing, ports.with_bench(nullptr)}.run());
  }
  auto joined = runtime::join_bench(introduce(participant, false), link::parse_bus_uri(bench).name);
  if (!joined) return runtime::stop_requested() ? kExitOk : kExitLost;
  runtime::BenchClient client{std::move(joined->socket), participant.lines().size()};
  return to_exit_status(
      runtime::RealTimeDriver{participant, can, &client, joined->welcome, ports.with_bench(&client)}.run());
}

/// Joins the wire, takes the driver that it asks for (lockstep or real time), and runs until told to stop.
int run_on_wire(Participant& participant, const ProgramOptions& options, std::span<const serial::LinePort> lines) {
  spdlog::set_default_logger(spdlog::stderr_color_mt(std::string{participant.name()}));
  spdlog::set_pattern("%^%l%$ %v");
  runtime::catch_stop_signals();
  if (options.rt_priority > 0) runtime::become_real_time(options.rt_priority);
  const link::BusUri uri = link::parse_bus_uri(options.can);
  const OwnPorts ports{participant, lines};
  if (uri.kind == link::BusUri::Kind::kVirtual) return run_on_embedded_bus(participant, uri.name, ports);
  return run_on_own_bus(participant, *link::open_can_link(uri), options.bench, ports);
}

}  // namespace

int complain(const std::string& what, const std::string& hint) {
  fmt::print(stderr, "error: {}\n", what);
  if (!hint.empty()) fmt::print(stderr, "hint: {}\n", hint);
  return kExitBadInput;
}

void add_options(CLI::App& app, ProgramOptions& options) {
  app.add_option("--rig", options.rig, "machine description (TOML)")->required();
  app.add_option("--can", options.can, "virtual:NAME | can0, vcan0 ... | slcan:/dev/ttyACM0@500000 | none")
      ->capture_default_str();
  app.add_option("--line", options.lines,
                 "LINE=PORT: a serial line of the rig is this port, e.g. hopper=/dev/ttyUSB0, hopper=pty:/tmp/hopper");
  app.add_option("--rt", options.rt_priority, "SCHED_FIFO priority, 1..99, with locked memory; for a wall-clock bus")
      ->check(CLI::Range(1, 99));
  app.add_option("--bench", options.bench, "virtual:NAME of a bench to report to when the frames go over the kernel");
  app.footer(
      fmt::format("Exit status: 0 told to stop, 2 bad usage or file, 3 the bench was lost\n"
                  "Example: {} --rig fixtures/rigs/bizone.toml --can can0",
                  app.get_name()));
}

int run(CLI::App& app, const ProgramOptions& options, int argc, char** argv, const MakeParticipant& make) {
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help.
    return complain(error.what(), fmt::format("see {} --help", app.get_name()));
  }
  try {
    const config::Section root{config::read_toml_file(options.rig)};
    const config::Rig rig = config::read_rig(root);
    const auto lines = config::read_line_ports(options.lines, rig);
    return run_on_wire(*make(root, rig), options, lines);
  } catch (const config::ConfigError& error) {
    return complain(error.what(), error.hint());
  } catch (const link::LinkError& error) {
    return complain(error.what(), error.hint());
  } catch (const std::exception& error) {
    return complain(error.what(), {});
  }
}

}  // namespace meltbench::program
