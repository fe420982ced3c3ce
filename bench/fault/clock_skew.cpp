#include "bench/fault/clock_skew.hpp"

#include <algorithm>
#include <cmath>

namespace meltbench::fault {

Instant ClockSkew::to_local(Instant bench) const {
  const Nanos since = bench - from_;
  return shown_ + since + Nanos{std::llround(drift_ * static_cast<double>(since.count()))};
}

Instant ClockSkew::to_bench(Instant local) const {
  if (local == Instant::never()) return local;
  if (local <= shown_) return from_;
  const double since_ns = static_cast<double>((local - shown_).count()) / (1.0 + drift_);
  Instant bench = from_ + Nanos{static_cast<std::int64_t>(since_ns)};
  while (to_local(bench) < local) bench += 1ns;  // Rounding: at most a few.
  return bench;
}

runtime::PortStatus SkewedPort::wake(const Wakeup& in, Outbox& out, std::span<double> signals) {
  if (clock_.is_right()) return port_.wake(in, out, signals);
  frames_.assign(in.frames.begin(), in.frames.end());
  for (can::StampedFrame& frame : frames_) frame.at = clock_.to_local(frame.at);
  serial_.assign(in.serial.begin(), in.serial.end());
  for (SerialArrival& arrival : serial_) arrival.at = clock_.to_local(arrival.at);
  Wakeup local = in;
  local.now = clock_.to_local(in.now);
  local.frames = frames_;
  local.serial = serial_;
  const runtime::PortStatus status = port_.wake(local, out, signals);
  if (status != runtime::PortStatus::kOk) return status;
  out.wake_at(clock_.to_bench(out.deadline()), out.wake_on());
  for (Event& event : out.event_queue()) event.at = std::min(clock_.to_bench(event.at), in.now);
  return status;
}

}  // namespace meltbench::fault
