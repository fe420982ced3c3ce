/// A Modbus device that refuses for every reason there is: reading holding register N is answered by exception N.
/// Usage: exception_device PATH, which becomes a pseudo-terminal of 19200 baud, 8N1. Ends by signal.

#include <poll.h>

#include <vector>

#include "protocols/link/serial_link.hpp"
#include "protocols/modbus/rtu_server.hpp"
#include "protocols/runtime/real_time_clock.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace {

using namespace meltbench;

class RefusingMap final : public modbus::RegisterMap {
 public:
  bool supports(modbus::Function) const override { return true; }
  bool covers(modbus::Table, std::uint16_t, std::uint16_t, bool) const override { return true; }
  modbus::ExceptionCode read_registers(Instant, modbus::Table, std::uint16_t first, std::span<std::uint16_t>) override {
    return static_cast<modbus::ExceptionCode>(first);
  }
  modbus::ExceptionCode write_registers(Instant, std::uint16_t, std::span<const std::uint16_t>) override {
    return modbus::ExceptionCode::kNone;
  }
  modbus::ExceptionCode read_bits(Instant, modbus::Table, std::uint16_t, std::span<bool>) override {
    return modbus::ExceptionCode::kNone;
  }
  modbus::ExceptionCode write_coils(Instant, std::uint16_t, std::span<const bool>) override {
    return modbus::ExceptionCode::kNone;
  }
  modbus::Identity identity() const override { return {}; }
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) return 2;
  runtime::catch_stop_signals();
  link::SerialPort port{"pty:" + std::string{argv[1]}, {19200, serial::Parity::kNone, 1}};
  modbus::RtuServer server{modbus::make_line_timing(19200, 10)};
  RefusingMap map;
  server.add(1, map);
  std::vector<std::uint8_t> answer;
  while (!runtime::stop_requested()) {
    pollfd ready{port.fd(), POLLIN, 0};
    ::poll(&ready, 1, 1);  // A frame is over after 2 ms of silence.
    while (const auto bytes = port.receive()) server.on_bytes(Instant{bytes->at_monotonic}, bytes->bytes);
    server.on_time(Instant{runtime::read_monotonic()}, answer);
    if (!answer.empty()) static_cast<void>(port.write(answer));
    answer.clear();
  }
  return 0;
}
