#include "protocols/runtime/bench_client.hpp"

#include "protocols/runtime/real_time_clock.hpp"

namespace meltbench::runtime {

link::SendStatus BenchClient::send(const can::CanFrame& frame) noexcept {
  write_frame(writer_, read_monotonic(), frame);
  const link::SendStatus status = socket_.try_send(writer_.bytes());
  if (status == link::SendStatus::kFull) ++counters_.full;
  if (status == link::SendStatus::kDown) lost_ = true;
  return status;
}

std::optional<link::ReceivedFrame> BenchClient::receive() noexcept {
  std::span<const std::uint8_t> message;
  while (true) {
    const link::ReceiveStatus status = socket_.try_receive(message);
    if (status == link::ReceiveStatus::kClosed) lost_ = true;
    if (status != link::ReceiveStatus::kMessage) return std::nullopt;
    if (message_type(message) == link::MessageType::kStop) stopped_ = true;
    if (const auto stamped = read_frame(message)) {
      return link::ReceivedFrame{stamped->at.since_start, stamped->frame};
    }
  }
}

void BenchClient::report(Instant at, std::span<const Event> events, std::span<const double> signals) noexcept {
  write_report(writer_, at, events, signals);
  if (socket_.try_send(writer_.bytes()) == link::SendStatus::kDown) lost_ = true;
}

void BenchClient::report_timing(const LogHistogram& lateness) noexcept {
  write_timing(writer_, lateness);
  if (socket_.try_send(writer_.bytes()) == link::SendStatus::kDown) lost_ = true;
}

void BenchClient::poll_stop() noexcept {
  while (receive()) {
  }
}

}  // namespace meltbench::runtime
