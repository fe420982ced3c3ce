#include "protocols/runtime/lockstep_driver.hpp"

#include "protocols/runtime/bench_protocol.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::runtime {

DriverEnd run_lockstep(Participant& participant, link::BenchSocket& socket) {
  Outbox out;
  link::MessageWriter writer;
  WakeupStorage storage;
  std::vector<double> signals(participant.signals().size());
  std::span<const std::uint8_t> message;
  while (!stop_requested()) {
    const link::ReceiveStatus status = socket.receive(message);
    if (status == link::ReceiveStatus::kClosed) return DriverEnd::kBenchLost;
    if (status != link::ReceiveStatus::kMessage) continue;
    const auto in = read_wake(message, storage);
    if (!in) return message_type(message) == link::MessageType::kStop ? DriverEnd::kStopped : DriverEnd::kBenchLost;
    out.clear();
    participant.wake(*in, out);
    participant.read_signals(signals);
    write_done(writer, out, signals);
    if (!socket.send(writer.bytes())) return DriverEnd::kBenchLost;
  }
  return DriverEnd::kStopped;
}

}  // namespace meltbench::runtime
