#include "bench/cli/doctor_command.hpp"

#include <fmt/format.h>
#include <libserialport.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

#include "bench/report/report.hpp"
#include "protocols/link/bench_socket.hpp"
#include "protocols/link/socketcan_link.hpp"

namespace meltbench::cli {
namespace {

/// One line of the examination; the hint is for what is missing.
void print_finding(bool present, std::string_view what, const std::string& found, std::string_view hint) {
  fmt::print("  {:<4} {:<20} {}\n", present ? "yes" : "no", what, found);
  if (!present) fmt::print("       {:<20} {}\n", "", hint);
}

std::string read_first_line(const std::filesystem::path& path) {
  std::ifstream file{path};
  std::string line;
  std::getline(file, line);
  return line;
}

/// "can0 (up), vcan0 (down)"; empty if there is none.
std::string list_can_interfaces() {
  std::string text;
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator{"/sys/class/net", error}) {
    if (read_first_line(entry.path() / "type") != std::to_string(ARPHRD_CAN)) continue;
    const bool up = (std::strtoul(read_first_line(entry.path() / "flags").c_str(), nullptr, 0) & IFF_UP) != 0;
    text += fmt::format("{}{} ({})", text.empty() ? "" : ", ", entry.path().filename().string(), up ? "up" : "down");
  }
  return text;
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

void examine_can() {
  fmt::print("CAN\n");
  try {
    print_finding(true, "embedded bus", link::embedded_bus_folder(), "");
  } catch (const link::LinkError& error) {
    print_finding(false, "embedded bus", error.what(), error.hint());
  }
  const bool kernel = link::kernel_has_can();
  print_finding(kernel, "kernel CAN", kernel ? "CAN sockets can be opened" : "this kernel has no CAN sockets",
                "sudo modprobe can-raw vcan; without it runs go over the embedded bus, the default");
  const std::string interfaces = list_can_interfaces();
  print_finding(!interfaces.empty(), "CAN interfaces", interfaces.empty() ? "none" : interfaces,
                "virtual: sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up; "
                "USB adapter: sudo ip link set can0 up type can bitrate 500000");
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
  print_finding(
      real_time, "real-time priority", real_time ? "SCHED_FIFO is allowed" : "SCHED_FIFO is refused",
      "a line \"@realtime - rtprio 90\" in /etc/security/limits.d/, your user in that group, and a new login");
  rlimit locked{};
  ::getrlimit(RLIMIT_MEMLOCK, &locked);
  const bool can_lock = locked.rlim_cur == RLIM_INFINITY || locked.rlim_cur >= 64U * 1024U * 1024U || ::geteuid() == 0;
  print_finding(can_lock, "locked memory", can_lock ? "64 MiB and more" : fmt::format("{} KiB", locked.rlim_cur / 1024),
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

ExitStatus examine_machine() {
  examine_can();
  examine_serial();
  examine_time();
  examine_report();
  return ExitStatus::kHeld;
}

}  // namespace meltbench::cli
