#include "protocols/runtime/program.hpp"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include <optional>

#include "protocols/link/socketcan_link.hpp"
#include "protocols/runtime/bench_client.hpp"
#include "protocols/runtime/lockstep_driver.hpp"
#include "protocols/runtime/real_time_driver.hpp"
#include "protocols/runtime/real_time_process.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::runtime {
namespace {

constexpr int kExitOk = 0;
constexpr int kExitBadInput = 2;
constexpr int kExitLost = 3;

struct Joined {
  link::BenchSocket socket;
  link::Welcome welcome;
};

/// Says hello to a broker and waits for its welcome. Nothing: the broker went away, or we were told to stop, before.
std::optional<Joined> join(const Participant& participant, const std::string& bus_name, bool carries_frames) {
  link::BenchSocket socket{link::connect_embedded_bus(bus_name)};
  Hello hello{std::string{participant.name()}, carries_frames, {}, {}, {}};
  hello.signals.assign(participant.signals().begin(), participant.signals().end());
  hello.nodes.assign(participant.nodes().begin(), participant.nodes().end());
  hello.lines.assign(participant.lines().begin(), participant.lines().end());
  link::MessageWriter writer;
  write_hello(writer, hello);
  if (!socket.send(writer.bytes())) return std::nullopt;
  std::span<const std::uint8_t> message;
  while (!stop_requested()) {
    const link::ReceiveStatus status = socket.receive(message);
    if (status == link::ReceiveStatus::kClosed) return std::nullopt;
    if (status != link::ReceiveStatus::kMessage) continue;
    if (message_type(message) == link::MessageType::kStop) return std::nullopt;
    if (const auto welcome = read_welcome(message)) return Joined{std::move(socket), *welcome};
  }
  return std::nullopt;
}

int to_exit_status(DriverEnd end) {
  return end == DriverEnd::kStopped ? kExitOk : kExitLost;
}

int run_on_embedded_bus(Participant& participant, const std::string& bus_name) {
  auto joined = join(participant, bus_name, true);
  if (!joined) return stop_requested() ? kExitOk : kExitLost;
  if (joined->welcome.pace == link::Pace::kLockstep) {
    return to_exit_status(run_lockstep(participant, joined->socket));
  }
  BenchClient bus{std::move(joined->socket)};
  return to_exit_status(RealTimeDriver{participant, bus, &bus, joined->welcome}.run());
}

int run_on_kernel_bus(Participant& participant, const std::string& interface_name, const std::string& bench) {
  link::SocketCanLink can{interface_name};
  if (bench.empty()) {
    link::Welcome timing{link::Pace::kWallClock, 1.0, read_monotonic(), 10ms};
    return to_exit_status(RealTimeDriver{participant, can, nullptr, timing}.run());
  }
  auto joined = join(participant, link::parse_bus_uri(bench).name, false);
  if (!joined) return stop_requested() ? kExitOk : kExitLost;
  BenchClient client{std::move(joined->socket)};
  return to_exit_status(RealTimeDriver{participant, can, &client, joined->welcome}.run());
}

}  // namespace

int run_program(Participant& participant, const ProgramOptions& options) {
  spdlog::set_default_logger(spdlog::stderr_color_mt(std::string{participant.name()}));
  spdlog::set_pattern("%^%l%$ %v");
  catch_stop_signals();
  if (options.rt_priority > 0) become_real_time(options.rt_priority);
  const link::BusUri uri = link::parse_bus_uri(options.can);
  if (uri.kind == link::BusUri::Kind::kVirtual) return run_on_embedded_bus(participant, uri.name);
  return run_on_kernel_bus(participant, uri.name, options.bench);
}

int complain(const std::string& what, const std::string& hint) {
  fmt::print(stderr, "error: {}\n", what);
  if (!hint.empty()) fmt::print(stderr, "hint: {}\n", hint);
  return kExitBadInput;
}

}  // namespace meltbench::runtime
