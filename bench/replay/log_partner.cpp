#include "bench/replay/log_partner.hpp"

#include <algorithm>

namespace meltbench::replay {

LogPartner::LogPartner(const Script& script, LiveSide live, Comparison& comparison)
    : script_{script}, live_{live}, comparison_{comparison} {}

void LogPartner::wake(const Wakeup& in, Outbox& out) {
  // What the recording says up to now is expected before the answers are looked at.
  std::size_t expected = next_;
  for (; expected < script_.frames.size() && script_.frames[expected].at <= in.now; ++expected) {
  }
  for (const can::StampedFrame& stamped : in.frames) {
    while (next_ < expected && !is_played(script_.frames[next_])) comparison_.expect(script_.frames[next_++]);
    comparison_.answer(stamped.at, stamped.frame);
  }
  comparison_.expire(in.now);
  while (next_ < expected) {
    const ScriptFrame& frame = script_.frames[next_];
    if (!is_played(frame)) {
      comparison_.expect(frame);
    } else if (comparison_.is_waiting()) {
      break;  // The live party has not yet said what came before.
    } else {
      comparison_.hear(frame.frame);
      out.send(frame.frame);
    }
    ++next_;
  }
  const Instant next = next_ < script_.frames.size() ? std::max(script_.frames[next_].at, in.now) : Instant::never();
  out.wake_at(next > in.now ? std::min(next, comparison_.next_expiry()) : comparison_.next_expiry());
}

}  // namespace meltbench::replay
