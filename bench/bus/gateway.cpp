#include "bench/bus/gateway.hpp"

namespace meltbench::bus {
namespace {

constexpr Nanos kLookPeriod = 100ms;

}  // namespace

void Gateway::send(const can::CanFrame& frame) {
  if (up_ && waiting_.size() < kMaxWaiting)
    waiting_.push_back(frame);
  else
    ++lost_;
}

void Gateway::exchange(Instant now, std::vector<link::ReceivedFrame>& arrived, std::vector<Event>& events) {
  if (!up_ && now < next_look_) return;
  note_state(link_.is_up(), now, events);
  if (!up_) return;
  while (!waiting_.empty()) {
    const link::SendStatus status = link_.send(waiting_.front());
    if (status == link::SendStatus::kFull || status == link::SendStatus::kDown) break;
    if (status == link::SendStatus::kUnsupported) ++lost_;
    waiting_.pop_front();
  }
  while (const auto received = link_.receive()) arrived.push_back(*received);
}

void Gateway::note_state(bool up, Instant now, std::vector<Event>& events) {
  if (!up) next_look_ = now + kLookPeriod;
  if (up == up_) return;
  up_ = up;
  if (!up) {
    lost_ += waiting_.size();
    waiting_.clear();
  }
  events.push_back({now, up ? Severity::kInfo : Severity::kWarning, up ? "link-up" : "link-down",
                    up ? "the CAN adapter is there again" : "the CAN adapter has gone"});
}

}  // namespace meltbench::bus
