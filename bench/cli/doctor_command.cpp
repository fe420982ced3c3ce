#include "bench/cli/doctor_command.hpp"

#include <fmt/format.h>
#include <libserialport.h>
#include <poll.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "bench/report/report.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/toml.hpp"
#include "protocols/link/bench_socket.hpp"
#include "protocols/link/can_interface.hpp"
#include "protocols/link/socketcan_link.hpp"
#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::cli {
namespace {

/// One line of the examination; the hint is for what is missing.
void print_finding(bool present, std::string_view what, const std::string& found, std::string_view hint) {
  fmt::print("  {:<4} {:<20} {}\n", present ? "yes" : "no", what, found);
  if (!present) fmt::print("       {:<20} {}\n", "", hint);
}

std::string bit_rate_text(std::uint32_t bit_per_s) {
  return bit_per_s % 1000 == 0 ? fmt::format("{} kbit/s", bit_per_s / 1000) : fmt::format("{} bit/s", bit_per_s);
}

/// "up, 500 kbit/s (sample point 87.5 %), error-active, error counters tx 0 rx 0, queue 1000".
std::string describe(const link::CanInterface& can) {
  std::string text = can.is_up ? "up" : "down";
  if (can.kind == "vcan" || can.kind == "vxcan") text += ", virtual";
  if (can.bit_rate_bit_per_s) text += ", " + bit_rate_text(*can.bit_rate_bit_per_s);
  if (can.sample_point_permille) text += fmt::format(" (sample point {:.1f} %)", *can.sample_point_permille / 10.0);
  if (can.data_bit_rate_bit_per_s) text += ", data " + bit_rate_text(*can.data_bit_rate_bit_per_s);
  if (can.is_up && can.state) text += fmt::format(", {}", *can.state);
  if (can.tx_errors) text += fmt::format(", error counters tx {} rx {}", *can.tx_errors, can.rx_errors.value_or(0));
  if (can.bus_offs.value_or(0) > 0) text += fmt::format(", {} times bus-off", *can.bus_offs);
  if (can.termination_ohm) text += fmt::format(", termination {} ohm", *can.termination_ohm);
  text += fmt::format(", queue {}, sent {}, received {}", can.queue_length, can.tx_frames, can.rx_frames);
  if (can.rx_dropped + can.tx_dropped > 0) text += fmt::format(", dropped {}", can.rx_dropped + can.tx_dropped);
  return text;
}

/// What is wrong with an interface, and what to do, one each.
std::vector<std::string> find_faults(const link::CanInterface& can, std::optional<std::uint32_t> rig_rate_bit_per_s) {
  constexpr std::uint32_t kLongEnough = 100;  // A boot sends dozens of frames at once.
  std::vector<std::string> faults;
  const std::uint32_t rate = rig_rate_bit_per_s.value_or(can.bit_rate_bit_per_s.value_or(500'000));
  const bool is_virtual = can.kind == "vcan" || can.kind == "vxcan";
  const std::string type = is_virtual ? "" : fmt::format(" type can bitrate {} restart-ms 100", rate);
  if (!can.is_up) faults.push_back(fmt::format("it is down: sudo ip link set {} up{}", can.name, type));
  if (rig_rate_bit_per_s && can.bit_rate_bit_per_s && *can.bit_rate_bit_per_s != *rig_rate_bit_per_s) {
    faults.push_back(
        fmt::format("the rig wants {}: sudo ip link set {} down, then up{}", bit_rate_text(rate), can.name, type));
  }
  if (can.is_up && can.state == "bus-off") {
    faults.push_back(
        fmt::format("it has switched itself off: look at bit rate, wiring and termination (60 ohm between "
                    "CAN_H and CAN_L without power), then: sudo ip link set {} type can restart",
                    can.name));
  } else if (can.is_up && can.state && *can.state != "error-active") {
    faults.emplace_back(
        can.tx_errors.value_or(0) >= can.rx_errors.value_or(0)
            ? "what it sends is not acknowledged: is another node on the bus, powered, at the same bit rate?"
            : "what it hears is broken: two bit rates on one wire, or termination (120 ohm at both ends, nowhere "
              "else)");
  }
  if (!is_virtual && can.restart_ms == 0U) {
    faults.push_back(
        fmt::format("after a bus-off it stays off; to come back by itself: sudo ip link set {} down, then "
                    "up{}",
                    can.name, type));
  }
  if (!is_virtual && can.queue_length < kLongEnough) {
    faults.push_back(
        fmt::format("its queue is short, a boot may find it full (ENOBUFS; survived, but late): sudo ip "
                    "link set {} txqueuelen 1000",
                    can.name));
  }
  return faults;
}

std::string list_serial_ports() {
  std::string text;
  sp_port** ports = nullptr;
  if (sp_list_ports(&ports) != SP_OK) return text;
  for (sp_port** port = ports; *port != nullptr; ++port) {
    text += fmt::format("{}{}", text.empty() ? "" : ", ", sp_get_port_name(*port));
  }
  sp_free_port_list(ports);
  return text;
}

/// Whether a thread of this user may take a real-time priority; tried out, in a thread that ends with it.
bool may_be_real_time() {
  bool allowed = false;
  std::thread{[&allowed] {
    const sched_param parameter{.sched_priority = 10};
    allowed = ::sched_setscheduler(0, SCHED_FIFO, &parameter) == 0;
  }}.join();
  return allowed;
}

void examine_can(std::optional<std::uint32_t> rig_rate_bit_per_s) {
  fmt::print("CAN\n");
  try {
    print_finding(true, "embedded bus", link::embedded_bus_folder(), "");
  } catch (const link::LinkError& error) {
    print_finding(false, "embedded bus", error.what(), error.hint());
  }
  const bool kernel = link::kernel_has_can();
  print_finding(kernel, "kernel CAN", kernel ? "CAN sockets can be opened" : "this kernel has no CAN sockets",
                "sudo modprobe can-raw vcan; without it runs go over the embedded bus, the default");
  const std::vector<link::CanInterface> interfaces = link::list_can_interfaces();
  for (const link::CanInterface& can : interfaces) {
    const std::vector<std::string> faults = find_faults(can, rig_rate_bit_per_s);
    fmt::print("  {:<4} {:<20} {}\n", faults.empty() ? "yes" : "look", can.name, describe(can));
    for (const std::string& fault : faults) fmt::print("       {:<20} {}\n", "", fault);
  }
  if (!interfaces.empty()) return;
  print_finding(false, "CAN interfaces", "none",
                "virtual: sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up; "
                "USB adapter: plug it in, then sudo ip link set can0 up type can bitrate 500000 restart-ms 100");
}

std::string_view name_of_state(std::uint8_t state) {
  switch (state & 0x7FU) {
    case 0x00:
      return "boots";
    case 0x04:
      return "stopped";
    case 0x05:
      return "operational";
    case 0x7F:
      return "pre-operational";
    default:
      return "in an unknown state";
  }
}

/// Listens for heartbeats and names who sends them. @returns whether every board of the rig was heard.
bool listen(const std::string& interface_name, const config::Rig* rig) {
  constexpr Nanos kTime = 2s;
  fmt::print("Who is on {}\n", interface_name);
  link::SocketCanLink can{interface_name};
  std::map<std::uint8_t, std::pair<Nanos, std::uint8_t>> heard;  // By node id: when first, and its last state.
  std::uint64_t frames = 0;
  const Nanos start = runtime::read_monotonic();
  while (runtime::read_monotonic() < start + kTime) {
    pollfd waiting{can.fd(), POLLIN, 0};
    ::poll(&waiting, 1, 50);
    while (const auto received = can.receive()) {
      ++frames;
      const can::CanFrame& frame = received->frame;
      if (frame.kind != can::FrameKind::kData || frame.extended || frame.id >> 7U != 0x0E || frame.length != 1)
        continue;
      const auto node_id = static_cast<std::uint8_t>(frame.id & 0x7FU);
      const auto [first, is_new] = heard.try_emplace(node_id, received->at_monotonic - start, frame.bytes[0]);
      first->second.second = frame.bytes[0];
    }
  }
  fmt::print("  {} frames in {:.0f} s, {} of them error frames\n", frames, to_s(kTime), can.counters().errors);
  const auto print = [&](std::uint8_t node_id, const std::string& name) {
    const auto found = heard.find(node_id);
    if (found == heard.end()) {
      print_finding(false, name, fmt::format("node {}: not heard", node_id),
                    "powered? this node id and bit rate? a board is silent until its heartbeat time (0x1017) is set");
      return false;
    }
    print_finding(true, name,
                  fmt::format("node {}: first heartbeat after {:.3f} s, {}", node_id, to_s(found->second.first),
                              name_of_state(found->second.second)),
                  "");
    heard.erase(found);
    return true;
  };
  bool all = true;
  for (std::size_t i = 0; rig != nullptr && i < rig->boards.size(); ++i) {
    if (!rig->boards[i].is_on_line()) all = print(rig->boards[i].node_id, rig->boards[i].name) && all;
  }
  while (!heard.empty()) {
    const std::uint8_t node_id = heard.begin()->first;
    print(node_id, rig != nullptr && node_id == rig->controller_node_id ? "controller" : "no board of a rig");
  }
  return all;
}

void examine_serial() {
  fmt::print("Serial\n");
  const std::string ports = list_serial_ports();
  print_finding(!ports.empty(), "ports", ports.empty() ? "none" : ports,
                "plug the adapter in; your user must be in the group dialout");
}

void examine_time() {
  fmt::print("Time\n");
  const bool real_time = may_be_real_time();
  rlimit priority{};
  ::getrlimit(RLIMIT_RTPRIO, &priority);
  print_finding(
      real_time, "real-time priority",
      real_time ? "SCHED_FIFO is allowed" : fmt::format("SCHED_FIFO is refused (rtprio limit {})", priority.rlim_cur),
      ::geteuid() == 0
          ? "even to root: the container or sandbox must allow it (docker run --cap-add SYS_NICE)"
          : "a line \"@realtime - rtprio 90\" in /etc/security/limits.d/, your user in that group, and a new login");
  rlimit locked{};
  ::getrlimit(RLIMIT_MEMLOCK, &locked);
  const bool can_lock = locked.rlim_cur == RLIM_INFINITY || locked.rlim_cur >= 64U * 1024U * 1024U || ::geteuid() == 0;
  print_finding(
      can_lock, "locked memory",
      can_lock ? "64 MiB and more may be locked" : fmt::format("only {} KiB may be locked", locked.rlim_cur / 1024),
      "\"@realtime - memlock unlimited\" in /etc/security/limits.d/");
  const unsigned processors = std::thread::hardware_concurrency();
  print_finding(processors >= 2, "processors", std::to_string(processors), "real-time runs want two or more");
}

void examine_report() {
  fmt::print("Report\n");
  const std::filesystem::path script = std::filesystem::path{MELTBENCH_DYGRAPHS_DIR} / "dist" / "dygraph.min.js";
  const bool present = std::filesystem::exists(script);
  print_finding(present, "dygraphs", script.string(), "sudo apt-get install libjs-dygraphs");
}

}  // namespace

ExitStatus examine_machine(const Examination& examination) {
  std::optional<config::Rig> rig;
  if (!examination.rig.empty()) rig = config::read_rig(config::Section{config::read_toml_file(examination.rig)});
  examine_can(rig ? std::optional{rig->bus.bit_rate_bit_per_s} : std::nullopt);
  examine_serial();
  examine_time();
  examine_report();
  if (examination.can.empty()) return ExitStatus::kHeld;
  const link::BusUri uri = link::parse_bus_uri(examination.can);
  if (uri.kind != link::BusUri::Kind::kSocketCan) {
    throw std::invalid_argument{"doctor listens to kernel interfaces only: what is on an embedded bus, a run records"};
  }
  return listen(uri.name, rig ? &*rig : nullptr) ? ExitStatus::kHeld : ExitStatus::kFailed;
}

}  // namespace meltbench::cli
