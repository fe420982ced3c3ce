#include "protocols/canopen/heartbeat.hpp"

#include <algorithm>

namespace meltbench::canopen {

can::CanFrame make_heartbeat(std::uint8_t node, NmtState state) {
  return can::make_frame(cob_id::heartbeat(node), {static_cast<std::uint8_t>(state)});
}

void HeartbeatConsumer::watch(std::uint8_t node, Nanos timeout) {
  std::erase_if(watched_, [node](const Watched& w) { return w.node == node; });
  if (timeout > Nanos{0}) watched_.push_back({.node = node, .timeout = timeout});
  update_deadline();
}

void HeartbeatConsumer::watch_from(Instant now, std::uint8_t node, Nanos timeout) {
  watch(node, timeout);
  if (timeout <= Nanos{0}) return;
  watched_.back().expires = now + timeout;
  update_deadline();
}

void HeartbeatConsumer::clear() {
  watched_.clear();
  update_deadline();
}

std::optional<HeartbeatEvent> HeartbeatConsumer::on_frame(Instant now, const can::CanFrame& frame) {
  if (frame.kind != can::FrameKind::kData || frame.extended || frame.fd || frame.length != 1) return {};
  const auto place =
      std::ranges::find_if(watched_, [&](const Watched& w) { return cob_id::heartbeat(w.node) == frame.id; });
  if (place == watched_.end()) return {};

  const auto state = static_cast<NmtState>(frame.bytes[0] & 0x7FU);
  std::optional<HeartbeatChange> change;
  if (state != place->state) change = HeartbeatChange::kState;
  if (state == NmtState::kInitialising) change = HeartbeatChange::kBootUp;
  if (!place->heard) change = HeartbeatChange::kFirst;
  if (place->lost) change = HeartbeatChange::kBack;
  place->state = state;
  place->heard = true;
  place->lost = false;
  place->expires = now + place->timeout;
  update_deadline();
  if (!change) return {};
  return HeartbeatEvent{place->node, *change, state};
}

std::optional<HeartbeatEvent> HeartbeatConsumer::take_lost(Instant now) {
  if (now < deadline_) return {};
  for (Watched& w : watched_) {
    if (now < w.expires) continue;
    w.expires = Instant::never();
    w.lost = true;
    update_deadline();
    return HeartbeatEvent{w.node, HeartbeatChange::kLost, w.state};
  }
  return {};
}

const HeartbeatConsumer::Watched* HeartbeatConsumer::find(std::uint8_t node) const {
  const auto place = std::ranges::find(watched_, node, &Watched::node);
  return place == watched_.end() ? nullptr : &*place;
}

bool HeartbeatConsumer::is_watched(std::uint8_t node) const {
  return find(node) != nullptr;
}

bool HeartbeatConsumer::is_alive(std::uint8_t node) const {
  const Watched* const w = find(node);
  return w != nullptr && w->heard && !w->lost;
}

std::optional<NmtState> HeartbeatConsumer::state(std::uint8_t node) const {
  const Watched* const w = find(node);
  return w != nullptr && w->heard ? std::optional{w->state} : std::nullopt;
}

void HeartbeatConsumer::update_deadline() {
  deadline_ = Instant::never();
  for (const Watched& w : watched_) deadline_ = std::min(deadline_, w.expires);
}

}  // namespace meltbench::canopen
