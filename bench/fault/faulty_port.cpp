#include "bench/fault/faulty_port.hpp"

#include <algorithm>
#include <limits>

namespace meltbench::fault {

runtime::PortStatus FaultyPort::wake(const Wakeup& in, Outbox& out, std::span<double> signals) {
  if (condition_.kills > 0) {
    be_dead(out, signals);
    return runtime::PortStatus::kOk;
  }
  return condition_.clock.is_right() ? port_.wake(in, out, signals) : wake_by_its_clock(in, out, signals);
}

void FaultyPort::be_dead(Outbox& out, std::span<double> signals) const {
  out.clear();
  const auto infos = port_.signals();
  for (std::size_t i = 0; i < infos.size(); ++i) {
    if (infos[i].kind == SignalKind::kValue) signals[i] = std::numeric_limits<double>::quiet_NaN();
  }
}

runtime::PortStatus FaultyPort::wake_by_its_clock(const Wakeup& in, Outbox& out, std::span<double> signals) {
  const ClockSkew& clock = condition_.clock;
  frames_.assign(in.frames.begin(), in.frames.end());
  for (can::StampedFrame& frame : frames_) frame.at = clock.to_local(frame.at);
  serial_.assign(in.serial.begin(), in.serial.end());
  for (SerialArrival& arrival : serial_) arrival.at = clock.to_local(arrival.at);
  Wakeup local = in;
  local.now = clock.to_local(in.now);
  local.frames = frames_;
  local.serial = serial_;
  const runtime::PortStatus status = port_.wake(local, out, signals);
  if (status != runtime::PortStatus::kOk) return status;
  out.wake_at(clock.to_bench(out.deadline()), out.wake_on());
  for (Event& event : out.event_queue()) event.at = std::min(clock.to_bench(event.at), in.now);
  return status;
}

}  // namespace meltbench::fault
