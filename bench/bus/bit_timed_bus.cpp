#include "bench/bus/bit_timed_bus.hpp"

#include <algorithm>
#include <bit>
#include <cmath>

namespace meltbench::bus {
namespace {

constexpr std::uint64_t bit_of(std::size_t node) {
  return std::uint64_t{1} << node;
}

constexpr std::uint64_t kNothing = std::numeric_limits<std::uint64_t>::max();

/// SplitMix64 (Steele, Lea, Flood 2014): a step of it, as a number in (0, 1].
double draw_unit(std::uint64_t& state) {
  state += 0x9E3779B97F4A7C15U;
  std::uint64_t z = state;
  z = (z ^ (z >> 30U)) * 0xBF58476D1CE4E5B9U;
  z = (z ^ (z >> 27U)) * 0x94D049BB133111EBU;
  z ^= z >> 31U;
  return (static_cast<double>(z >> 11U) + 1.0) * 0x1p-53;
}

}  // namespace

BitTimedBus::BitTimedBus(const BitTimedSettings& settings, std::size_t nodes, BusListener& listener)
    : settings_{settings}, listener_{&listener}, tuning_(nodes), keys_(nodes, kNothing), tallies_(nodes) {
  nodes_.reserve(nodes);
  for (std::size_t i = 0; i < nodes; ++i) {
    nodes_.emplace_back(i, settings.tx_queue, settings.tx_order, settings.restart_after, listener);
  }
  flips_.reserve(16);
  look_at_nodes();
}

bool BitTimedBus::send(Instant now, std::size_t node, const can::CanFrame& frame) {
  if (!nodes_[node].send(now, frame)) return false;
  if (waiting_ == 0) waiting_since_ = now;
  if (keys_[node] == kNothing) tallies_[node].waiting_from = rounds_ + (mode_ == Mode::kFrame ? 1 : 0);
  note_head(node);
  return true;
}

void BitTimedBus::note_head(std::size_t node) {
  const Pending* offered = nodes_[node].head(Instant::never());
  keys_[node] = offered != nullptr ? offered->key : kNothing;
  waiting_ = offered != nullptr ? waiting_ | bit_of(node) : waiting_ & ~bit_of(node);
}

Instant BitTimedBus::next_event() const {
  switch (mode_) {
    case Mode::kFrame:
      return std::min(next_restart_, flight_.end);
    case Mode::kBits:
      return bit_end_;
    case Mode::kQuiet:
      break;
  }
  return waiting_ == 0 ? next_restart_ : std::min(next_restart_, std::max(free_at_, waiting_since_));
}

void BitTimedBus::advance(Instant to) {
  for (Instant due = next_event(); due <= to && due != Instant::never(); due = next_event()) {
    if (mode_ == Mode::kBits) {
      step();
    } else if (next_restart_ <= due) {
      interrupt(due);
      leave_quiet(due);
    } else if (mode_ == Mode::kFrame) {
      finish_frame();
    } else {
      arbitrate(due);
    }
  }
}

void BitTimedBus::arbitrate(Instant at) {
  Flight flight;
  flight.start = at;
  const auto best = std::ranges::min_element(keys_);
  const bool collides = std::find(best + 1, keys_.end(), *best) != keys_.end();
  flight.sender = static_cast<std::size_t>(best - keys_.begin());
  flight.pending = nodes_[flight.sender].head(at);
  const can::FrameLength length = flight.pending->length;
  flight.bits = length.nominal_bits + length.data_bits;
  if (!is_plain(flight, collides)) return begin_bits(at);
  const Nanos on_wire = can::time_on_wire(length, settings_.bit_time, settings_.data_bit_time);
  flight.end = at + stretch(on_wire, flight.sender);
  flight_ = flight;
  mode_ = Mode::kFrame;
}

/// True if nothing can happen to this frame but what happens to every frame.
bool BitTimedBus::is_plain(const Flight& flight, bool collides) const {
  if (collides || wire_ != WireState::kGood || tuned_ || troubled_ != 0) return false;
  if ((idle_ & ~bit_of(flight.sender)) == 0) return false;  // Nobody there to acknowledge.
  if (bits_to_noise_ < flight.bits) return false;
  const std::uint32_t id = flight.pending->frame.id;
  return std::ranges::none_of(flips_, [&](const BitFlip& flip) { return ((flip.id ^ id) & flip.mask) == 0; });
}

void BitTimedBus::finish_frame() {
  const Pending sent = *flight_.pending;
  const std::size_t sender = flight_.sender;
  nodes_[sender].count_arbitrations_lost(rounds_ - tallies_[sender].waiting_from);
  nodes_[sender].finish_sent(flight_.end, *flight_.pending);
  ++crossed_packets_;
  crossed_bytes_ += sent.frame.data().size();
  ++tallies_[sender].own_packets;
  tallies_[sender].own_bytes += sent.frame.data().size();
  tallies_[sender].waiting_from = ++rounds_;
  note_head(sender);
  if (bit_error_rate_ > 0) bits_to_noise_ -= flight_.bits;
  free_at_ = flight_.end + can::kIntermissionBits * settings_.bit_time;
  busy_ += free_at_ - flight_.start;
  mode_ = Mode::kQuiet;
  listener_->on_delivery({flight_.end, sender, idle_ & ~bit_of(sender), sent.frame, sent.queued_at, flight_.start});
}

/// Lets the nodes count what has crossed frame by frame since the last time. Which nodes are in step has not changed.
void BitTimedBus::count_up() {
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    Tally& tally = tallies_[i];
    if ((idle_ & bit_of(i)) != 0) {
      nodes_[i].count_received(crossed_packets_ - tally.own_packets, crossed_bytes_ - tally.own_bytes);
    }
    if (keys_[i] != kNothing && tally.waiting_from < rounds_) {
      nodes_[i].count_arbitrations_lost(rounds_ - tally.waiting_from);
      tally.waiting_from = rounds_;
    }
    tally.own_packets = tally.own_bytes = 0;
  }
  crossed_packets_ = crossed_bytes_ = 0;
}

const BusNode& BitTimedBus::node(std::size_t number) {
  if (mode_ != Mode::kBits) count_up();
  return nodes_[number];
}

/// A frame on the wire goes on bit by bit, because something changes in the middle of it.
void BitTimedBus::interrupt(Instant now) {
  if (mode_ == Mode::kFrame) begin_bits(flight_.start);
  while (mode_ == Mode::kBits && bit_end_ <= now) step();
}

/// Every node by itself from now on, until all are idle again.
void BitTimedBus::leave_quiet(Instant now) {
  if (mode_ == Mode::kQuiet) begin_bits(std::max(now, free_at_));
}

void BitTimedBus::begin_bits(Instant at) {
  count_up();
  mode_ = Mode::kBits;
  bit_start_ = at;
  bit_end_ = at + settings_.bit_time;
}

void BitTimedBus::step() {
  if (next_restart_ <= bit_start_) {
    for (BusNode& node : nodes_) node.restart_if_due(bit_start_);
  }
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if ((bit_number_ - tuning_[i].in_step_at) % tuning_[i].divider != 0) continue;  // In the middle of one of its bits.
    dominant_ = nodes_[i].drive(bit_start_) ? dominant_ | bit_of(i) : dominant_ & ~bit_of(i);
  }
  const std::size_t sender = find_sender();
  if (sender != kNoNode && nodes_[sender].position() == 0) {
    anchor_ = bit_start_;
    since_anchor_ = settings_.bit_time;
    anchored_ = true;
  }
  if (std::ranges::any_of(nodes_, &BusNode::is_busy)) busy_ += bit_end_ - bit_start_;
  const std::uint64_t misheard = sender == kNoNode ? 0 : apply_flips(sender);
  sample_nodes(resolve_wire(), misheard);
  ++bit_number_;
  tell_received();
  begin_next_bit();
}

/// @returns true if the wire is recessive.
bool BitTimedBus::resolve_wire() const {
  if (wire_ == WireState::kStuckDominant) return false;
  if (wire_ == WireState::kShorted) return true;
  std::uint64_t connected = dominant_;
  for (std::size_t i = 0; tuned_ && i < nodes_.size(); ++i) {
    if (tuning_[i].cut_off) connected &= ~bit_of(i);
  }
  return connected == 0;
}

bool BitTimedBus::hit_by_noise() {
  if (bit_error_rate_ == 0 || bits_to_noise_-- != 0) return false;
  draw_noise();
  return true;
}

/// @returns the nodes that see this bit of the sender's inverted.
std::uint64_t BitTimedBus::apply_flips(std::size_t sender) {
  std::uint64_t misheard = hit_by_noise() ? ~std::uint64_t{0} : 0;
  const BusNode& node = nodes_[sender];
  for (BitFlip& flip : flips_) {
    if (((flip.id ^ node.sending_frame()->frame.id) & flip.mask) != 0 || node.position() != flip.bit) continue;
    if (flip.probability < 1.0 && draw_unit(flip.seed) > flip.probability) continue;
    misheard ^= flip.listener == kNoNode ? ~std::uint64_t{0} : bit_of(flip.listener);
    --flip.frames;
  }
  std::erase_if(flips_, [](const BitFlip& flip) { return flip.frames == 0; });
  return misheard;
}

void BitTimedBus::sample_nodes(bool recessive, std::uint64_t misheard) {
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    Tuning& tuning = tuning_[i];
    const bool level = tuning.cut_off ? (dominant_ & bit_of(i)) == 0 : recessive;
    const bool seen = level != ((misheard & bit_of(i)) != 0);
    const bool falls = recessive_before_ && !seen;
    if (tuning.divider > 1 && nodes_[i].is_idle() && falls) tuning.in_step_at = bit_number_;  // Hard synchronisation.
    if ((bit_number_ - tuning.in_step_at) % tuning.divider == tuning.divider - 1) nodes_[i].sample(bit_end_, seen);
  }
  recessive_before_ = recessive;
}

void BitTimedBus::tell_received() {
  Delivery delivery;
  delivery.at = bit_end_;
  delivery.sender = kNoNode;
  for (std::size_t i = 0; i < nodes_.size(); ++i) {
    if (nodes_[i].has_received()) {
      delivery.receivers |= bit_of(i);
      delivery.frame = nodes_[i].received();
    }
    if (const auto& sent = nodes_[i].has_sent(); sent && delivery.sender == kNoNode) {
      delivery.sender = i;
      delivery.queued_at = sent->queued_at;
      delivery.started_at = nodes_[i].started_at();
    }
    nodes_[i].forget_news();
  }
  if (delivery.receivers != 0) listener_->on_delivery(delivery);
}

void BitTimedBus::begin_next_bit() {
  bit_start_ = bit_end_;
  look_at_nodes();
  const bool all_quiet = std::ranges::all_of(nodes_, [](const BusNode& n) { return n.is_idle() || n.is_off(); });
  if (all_quiet && wire_ != WireState::kStuckDominant) {
    dominant_ = 0;
    mode_ = Mode::kQuiet;
    free_at_ = bit_start_;
    waiting_since_ = bit_start_;
    return;
  }
  const std::size_t sender = find_sender();
  if (sender == kNoNode) {
    anchored_ = false;
    bit_end_ = bit_start_ + settings_.bit_time;
    return;
  }
  if (!anchored_) {  // Connected in the middle of its frame.
    anchor_ = bit_start_;
    since_anchor_ = Nanos{};
    anchored_ = true;
  }
  const bool disturbed = std::ranges::any_of(nodes_, &BusNode::is_signalling);
  since_anchor_ += nodes_[sender].sending()->data_rate && !disturbed ? settings_.data_bit_time : settings_.bit_time;
  bit_end_ = anchor_ + stretch(since_anchor_, sender);
}

void BitTimedBus::look_at_nodes() {
  if (mode_ != Mode::kBits) count_up();
  idle_ = troubled_ = 0;
  next_restart_ = Instant::never();
  for (const BusNode& node : nodes_) {
    const std::uint64_t bit = bit_of(node.number());
    if (node.is_idle()) idle_ |= bit;
    if (node.is_troubled() && !node.is_off()) troubled_ |= bit;
    next_restart_ = std::min(next_restart_, node.restart_at());
    note_head(node.number());
    tallies_[node.number()].waiting_from = rounds_;
  }
}

/// Of several senders the first; they send the same so far.
std::size_t BitTimedBus::find_sender() const {
  for (const BusNode& node : nodes_) {
    if (node.sending() != nullptr && !tuning_[node.number()].cut_off) return node.number();
  }
  return kNoNode;
}

Nanos BitTimedBus::stretch(Nanos span, std::size_t sender) const {
  const double ppm = tuning_[sender].drift_ppm;
  if (ppm == 0) return span;
  return span - Nanos{std::llround(static_cast<double>(span.count()) * ppm * 1e-6)};
}

void BitTimedBus::draw_noise() {
  const double bits = std::log(draw_unit(noise_state_)) / std::log1p(-bit_error_rate_);
  constexpr double kFarOff = 1e18;
  bits_to_noise_ = static_cast<std::uint64_t>(std::min(bits, kFarOff));
}

void BitTimedBus::set_wire(Instant now, WireState wire) {
  interrupt(now);
  wire_ = wire;
  if (wire == WireState::kStuckDominant) leave_quiet(now);
}

void BitTimedBus::set_cut_off(Instant now, std::size_t node, bool cut_off) {
  interrupt(now);
  tuning_[node].cut_off = cut_off;
  tuned_ = std::ranges::any_of(tuning_, &Tuning::matters);
}

void BitTimedBus::set_bit_rate_divider(Instant now, std::size_t node, unsigned divider) {
  interrupt(now);
  tuning_[node].divider = std::max(divider, 1U);
  tuning_[node].in_step_at = bit_number_;
  tuned_ = std::ranges::any_of(tuning_, &Tuning::matters);
}

void BitTimedBus::set_clock_drift(Instant now, std::size_t node, double ppm) {
  interrupt(now);
  tuning_[node].drift_ppm = ppm;
}

void BitTimedBus::set_babble(Instant now, std::size_t node, const std::optional<can::CanFrame>& frame) {
  interrupt(now);
  nodes_[node].babble(frame);
  if (waiting_ == 0) waiting_since_ = now;
  look_at_nodes();
}

void BitTimedBus::set_powered(Instant now, std::size_t node, bool on) {
  interrupt(now);
  nodes_[node].set_powered(on);
  look_at_nodes();
  if (on) leave_quiet(now);
}

void BitTimedBus::set_noise(Instant now, double bit_error_rate, std::uint64_t seed) {
  interrupt(now);
  bit_error_rate_ = bit_error_rate;
  noise_state_ = seed;
  bits_to_noise_ = std::numeric_limits<std::uint64_t>::max();
  if (bit_error_rate > 0) draw_noise();
}

void BitTimedBus::flip(Instant now, const BitFlip& flip) {
  interrupt(now);
  flips_.push_back(flip);
}

void BitTimedBus::end_flips(Instant now, std::size_t number) {
  interrupt(now);
  std::erase_if(flips_, [&](const BitFlip& flip) { return flip.number == number; });
}

void BitTimedBus::force_bus_off(Instant now, std::size_t node) {
  interrupt(now);
  nodes_[node].force_bus_off(now);
  look_at_nodes();
}

void BitTimedBus::restart(Instant now, std::size_t node) {
  interrupt(now);
  nodes_[node].restart_at(now);
  look_at_nodes();
}

}  // namespace meltbench::bus
