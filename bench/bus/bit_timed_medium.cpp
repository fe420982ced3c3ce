#include "bench/bus/bit_timed_medium.hpp"

#include <fmt/format.h>
#include <linux/can/error.h>

#include <algorithm>
#include <stdexcept>
#include <tuple>

#include "bench/bus/run_observer.hpp"

namespace meltbench::bus {
namespace {

constexpr std::size_t kMaxRefused = 1024;  // As the real-time driver; more is a bus that does not move.
/// An error flag, the others' answers to it, delimiter and interframe space: reports within it are of one disturbance.
constexpr int kDisturbanceBits = 17;

std::size_t count_nodes(std::span<const BitTimedMedium::Member> members) {
  std::size_t nodes = 2;  // The stranger and the twin.
  for (const auto& member : members) nodes += std::max<std::size_t>(member.nodes.size(), 1);
  if (nodes > 64) throw std::invalid_argument{fmt::format("{} nodes on a bit-timed bus, at most 62", nodes - 2)};
  return nodes;
}

Event describe(Instant at, std::string_view node, can::ErrorState state) {
  switch (state) {
    case can::ErrorState::kBusOff:
      return {at, Severity::kFault, "bus-off", fmt::format("{} is bus-off", node)};
    case can::ErrorState::kPassive:
      return {at, Severity::kWarning, "error-passive", fmt::format("{} is error-passive", node)};
    case can::ErrorState::kActive:
      break;
  }
  return {at, Severity::kInfo, "error-active", fmt::format("{} is error-active again", node)};
}

}  // namespace

BitTimedSettings to_settings(const config::RigBus& bus) {
  BitTimedSettings settings;
  settings.bit_time = Nanos{1'000'000'000 / bus.bit_rate_bit_per_s};
  settings.data_bit_time = Nanos{1'000'000'000 / bus.data_bit_rate_bit_per_s};
  settings.tx_queue = bus.tx_queue;
  settings.tx_order = bus.tx_order == config::RigTxOrder::kFifo ? TxOrder::kFifo : TxOrder::kPriority;
  settings.restart_after = bus.restart_after;
  return settings;
}

BitTimedMedium::BitTimedMedium(const BitTimedSettings& settings, std::span<const Member> members,
                               MediumListener& listener)
    : listener_{listener}, bit_time_{settings.bit_time}, bus_{settings, count_nodes(members), *this} {
  for (std::size_t number = 0; number < members.size(); ++number) {
    const Member& member = members[number];
    Membership membership;
    membership.first_node = names_.size();
    membership.node_count = std::max<std::size_t>(member.nodes.size(), 1);
    membership.keeps_refused = member.nodes.empty();
    members_.push_back(std::move(membership));
    if (member.nodes.empty()) names_.emplace_back(member.name);
    names_.insert(names_.end(), member.nodes.begin(), member.nodes.end());
    owners_.resize(names_.size(), number);
  }
  names_.emplace_back(kStranger);
  owners_.push_back(kTapSender);
  names_.emplace_back(kTwin);
  owners_.push_back(kOutsideSender);
  states_.resize(names_.size());
  bus_.set_powered(Instant{}, stranger(), false);
  bus_.set_powered(Instant{}, twin(), false);
}

void BitTimedMedium::send(Instant now, std::size_t participant, std::size_t own_node, const can::CanFrame& frame) {
  Membership& member = members_[participant];
  const std::size_t node = member.first_node + std::min(own_node, member.node_count - 1);
  const bool keeps = member.keeps_refused && states_[node] != can::ErrorState::kBusOff;
  if (member.refused.empty() && bus_.send(now, node, frame)) return;
  if (keeps && member.refused.size() < kMaxRefused) {
    member.refused.push_back(frame);
  } else {
    ++lost_frames_;
  }
}

void BitTimedMedium::send_from_outside(Instant now, const can::CanFrame& frame) {
  const std::size_t node = stranger();
  if (bus_.node(node).is_off()) bus_.set_powered(now, node, true);
  if (!bus_.send(now, node, frame)) ++lost_frames_;
}

std::size_t BitTimedMedium::room_for_outside() {
  return bus_.node(stranger()).room();
}

void BitTimedMedium::plug_twin(Instant now, bool in) {
  bus_.set_powered(now, twin(), in);
}

void BitTimedMedium::send_waiting(Instant now, std::size_t participant) {
  Membership& member = members_[participant];
  while (!member.refused.empty() && bus_.send(now, member.first_node, member.refused.front())) {
    member.refused.pop_front();
  }
}

std::span<const can::ErrorState> BitTimedMedium::states(std::size_t participant) const {
  return std::span{states_}.subspan(members_[participant].first_node, members_[participant].node_count);
}

std::size_t BitTimedMedium::find_node(std::string_view name) const {
  const auto found = std::ranges::find(names_, name);
  return found == names_.end() ? kNoNode : static_cast<std::size_t>(found - names_.begin());
}

void BitTimedMedium::on_delivery(const Delivery& delivery) {
  count(delivery);
  std::uint64_t heard_by = 0;
  for (std::size_t node = 0; node < stranger(); ++node) {
    if (((delivery.receivers >> node) & 1U) != 0) heard_by |= std::uint64_t{1} << owners_[node];
  }
  const bool known = delivery.sender != kNoNode;
  listener_.on_crossed({delivery.at, delivery.frame}, known ? owners_[delivery.sender] : kOutsideSender, heard_by);
  if (known && owners_[delivery.sender] < members_.size()) send_waiting(delivery.at, owners_[delivery.sender]);
}

void BitTimedMedium::count(const Delivery& delivery) {
  const auto key = [](const ResponseTally& tally) { return std::tuple{tally.extended, tally.id}; };
  const std::tuple wanted{delivery.frame.extended, delivery.frame.id};
  auto found = std::ranges::lower_bound(responses_, wanted, {}, key);
  if (found == responses_.end() || key(*found) != wanted) {
    ResponseTally tally;
    std::tie(tally.extended, tally.id) = wanted;
    found = responses_.insert(found, tally);
  }
  if (delivery.sender == kNoNode) return;
  found->node = delivery.sender;
  ++found->frames;
  const Nanos delay = delivery.started_at - delivery.queued_at;
  const Nanos response = delivery.at - delivery.queued_at;
  found->sum_delay += delay;
  found->sum_response += response;
  found->worst_delay = std::max(found->worst_delay, delay);
  found->worst_response = std::max(found->worst_response, response);
}

void BitTimedMedium::on_error(Instant at, std::size_t node, const can::CanFrame& error) {
  if ((error.id & CAN_ERR_BUSERROR) != 0) {
    const bool same = last_error_at_ <= at && at - last_error_at_ < kDisturbanceBits * bit_time_;
    if (same) return;
    last_error_at_ = at;
  }
  listener_.on_error_frame({at, error}, owners_[node]);
}

void BitTimedMedium::on_state(Instant at, std::size_t node, can::ErrorState state) {
  states_[node] = state;
  const std::size_t owner = owners_[node];
  if (state == can::ErrorState::kBusOff && owner < members_.size()) {
    lost_frames_ += members_[owner].refused.size();
    members_[owner].refused.clear();
  }
  listener_.on_node_state(owner, describe(at, names_[node], state));
}

void BitTimedMedium::set_clock_drifts(std::span<const ClockDrift> drifts) {
  for (const ClockDrift& drift : drifts) {
    const std::size_t node = find_node(drift.node);
    if (node != kNoNode && drift.ppm != 0) bus_.set_clock_drift(Instant{}, node, drift.ppm);
  }
}

}  // namespace meltbench::bus
