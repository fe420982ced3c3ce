#include "protocols/canopen/node.hpp"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

namespace meltbench::canopen {
namespace {

constexpr std::uint32_t kSyncProducer = 0x4000'0000;
constexpr std::uint32_t kCobIdMask = 0x1FFF'FFFF;
constexpr std::uint8_t kMaxConsumers = 127;

std::uint8_t heartbeat_node(std::uint32_t consumer_entry) {
  return static_cast<std::uint8_t>(consumer_entry >> 16);
}
Nanos heartbeat_time(std::uint32_t consumer_entry) {
  return 1ms * (consumer_entry & 0xFFFFU);
}
bool is_in_use(std::uint32_t consumer_entry) {
  const std::uint8_t node = heartbeat_node(consumer_entry);
  return node >= 1 && node <= kMaxNodeId && heartbeat_time(consumer_entry) > Nanos{0};
}

/// Next point of the grid after now; points missed by a late call are left out.
Instant next_on_grid(Instant due, Nanos period, Instant now) {
  due += period;
  return due > now ? due : now + period;
}

/// When an event-driven TPDO may go next.
Instant next_sending(bool event_pending, Instant not_before, Instant timer) {
  return event_pending ? not_before : std::max(timer, not_before);
}

std::uint32_t to_number(std::span<const std::uint8_t> value) {
  std::uint32_t number = 0;
  if (!value.empty()) std::memcpy(&number, value.data(), std::min(value.size(), sizeof number));
  return number;
}

}  // namespace

Node::Node(ObjectDictionary dictionary, std::uint8_t node_id, NodeListener* listener)
    : dictionary_{std::move(dictionary)},
      node_id_{node_id},
      listener_{listener == nullptr ? &silent_ : listener},
      sdo_{cob_id::sdo_request(node_id), cob_id::sdo_response(node_id), *this},
      emcy_{dictionary_} {
  if (node_id == 0 || node_id > kMaxNodeId) {
    throw std::invalid_argument(fmt::format("CANopen node id {}, must be 1..{}", node_id, kMaxNodeId));
  }
  for (const Pdo& pdo : read_pdos(dictionary_, PdoDirection::kReceive)) rpdos_.push_back({pdo});
  for (const Pdo& pdo : read_pdos(dictionary_, PdoDirection::kTransmit)) tpdos_.push_back({pdo});
}

void Node::start(Instant now, Frames& out) {
  reset(now, ResetKind::kPowerOn, out);
  flush(now, out);
}

void Node::on_frame(Instant now, const can::CanFrame& frame, Frames& out) {
  const std::uint8_t interest = !frame.extended     ? interest_[frame.id & can::kMaxStandardId]
                                : any_extended_pdo_ ? static_cast<std::uint8_t>(kRpdo | kRemote)
                                                    : std::uint8_t{0};
  if (interest == 0 || frame.kind == can::FrameKind::kError || frame.fd) return;
  now_ = now;
  if (frame.kind == can::FrameKind::kRemote) {
    on_remote_frame(now, frame, out);
  } else {
    if ((interest & kNmt) != 0) on_nmt(now, frame, out);
    if ((interest & kSync) != 0) on_sync_frame(now, frame, out);
    if ((interest & kSdo) != 0 && state_ != NmtState::kStopped) sdo_.on_frame(now, frame, out);
    if ((interest & kRpdo) != 0) on_rpdo_frame(now, frame);
    if ((interest & kHeartbeat) != 0) {
      if (const auto event = heartbeats_.on_frame(now, frame)) on_heartbeat_event(now, *event, out);
    }
  }
  flush(now, out);
}

void Node::on_time(Instant now, Frames& out) {
  if (now < deadline_ || state_ == NmtState::kInitialising) return;
  now_ = now;
  produce_sync_if_due(now, out);
  while (const auto event = heartbeats_.take_lost(now)) on_heartbeat_event(now, *event, out);
  check_guarding(now, out);
  check_rpdo_deadlines(now);
  sdo_.on_time(now, out);
  flush(now, out);
}

void Node::flush(Instant now, Frames& out) {
  send_heartbeat_if_due(now, out);
  if (may_send_emcy() && emcy_.has_pending()) emcy_.send_due(now, out);
  if (state_ == NmtState::kOperational) send_due_tpdos(now, out);
  update_deadline();
}

void Node::update_deadline() {
  Instant deadline =
      std::min({heartbeat_due_, guard_expires_, sync_due_, sdo_.next_deadline(), heartbeats_.next_deadline()});
  if (may_send_emcy()) deadline = std::min(deadline, emcy_.next_deadline());
  if (state_ == NmtState::kOperational) {
    for (const Rpdo& rpdo : rpdos_) deadline = std::min(deadline, rpdo.expires);
    for (const Tpdo& tpdo : tpdos_) {
      if (!tpdo.active || tpdo.is_synchronous()) continue;
      deadline = std::min(deadline, next_sending(tpdo.event_pending, tpdo.not_before, tpdo.timer));
    }
  }
  deadline_ = deadline;
}

void Node::event(unsigned number) {
  if (state_ != NmtState::kOperational) return;
  for (Tpdo& tpdo : tpdos_) {
    if (tpdo.number != number || !tpdo.active) continue;
    if (tpdo.is_synchronous()) {
      tpdo.event_pending = tpdo.type == kSyncAcyclic;
    } else {
      tpdo.event_pending = true;
      deadline_ = std::min(deadline_, tpdo.not_before);
    }
  }
}

void Node::raise_emcy(std::uint16_t code, std::uint8_t register_bits, const ManufacturerBytes& manufacturer) {
  if (emcy_.raise(code, register_bits, manufacturer) && may_send_emcy()) {
    deadline_ = std::min(deadline_, emcy_.next_deadline());
  }
}

void Node::clear_emcy(std::uint16_t code, std::optional<std::uint8_t> instance) {
  if (emcy_.clear(code, instance) && may_send_emcy()) deadline_ = std::min(deadline_, emcy_.next_deadline());
}

bool Node::may_send_emcy() const {
  return state_ == NmtState::kPreOperational || state_ == NmtState::kOperational;
}

bool Node::is_tpdo_active(unsigned number) const {
  return std::ranges::any_of(tpdos_, [number](const Tpdo& tpdo) { return tpdo.number == number && tpdo.active; });
}

void Node::on_nmt(Instant now, const can::CanFrame& frame, Frames& out) {
  if (frame.length != 2 || (frame.bytes[1] != 0 && frame.bytes[1] != node_id_)) return;
  switch (static_cast<NmtCommand>(frame.bytes[0])) {
    case NmtCommand::kStart:
      return set_state(now, NmtState::kOperational);
    case NmtCommand::kStop:
      return set_state(now, NmtState::kStopped);
    case NmtCommand::kEnterPreOperational:
      return set_state(now, NmtState::kPreOperational);
    case NmtCommand::kResetNode:
      return reset(now, ResetKind::kNode, out);
    case NmtCommand::kResetCommunication:
      return reset(now, ResetKind::kCommunication, out);
  }
}

void Node::set_state(Instant now, NmtState state) {
  if (state == state_) return;
  const NmtState from = state_;
  state_ = state;
  if (from == NmtState::kOperational) disarm_pdos();
  if (from == NmtState::kStopped) sync_counter_ = 0;
  if (state == NmtState::kStopped) sdo_.reset();
  if (state == NmtState::kOperational) arm_pdos(now);
  listener_->on_state(now, from, state);
  update_deadline();
}

void Node::reset(Instant now, ResetKind kind, Frames& out) {
  now_ = now;
  const NmtState from = state_;
  state_ = NmtState::kInitialising;
  disarm_pdos();
  sdo_.reset();
  if (from != NmtState::kInitialising) listener_->on_state(now, from, state_);
  const bool only_communication = kind == ResetKind::kCommunication;
  parameters_.restore(dictionary_, only_communication ? ParameterGroup::kCommunication : ParameterGroup::kAll);
  emcy_.reset();
  listener_->on_reset(now, kind);
  read_communication_parameters(now);

  out.push_back(make_heartbeat(node_id_, NmtState::kInitialising));
  heartbeat_due_ = heartbeat_period_ > Nanos{0} ? now + heartbeat_period_ : Instant::never();
  set_state(now, NmtState::kPreOperational);
  const OdEntry* const startup = dictionary_.find(0x1F80, 0);
  const bool starts_itself = startup != nullptr && (startup->to_int64() & 0x04) == 0;
  if (starts_itself) set_state(now, NmtState::kOperational);
}

void Node::read_communication_parameters(Instant now) {
  heartbeat_period_ = 1ms * dictionary_.integer_or(0x1017, 0, 0);
  guard_toggle_ = 0;
  guard_expires_ = Instant::never();
  sync_due_ = Instant::never();
  emcy_.read_parameters();
  read_heartbeat_consumers();
  read_sync_parameters(now);
  for (Rpdo& rpdo : rpdos_) read_pdo(dictionary_, PdoDirection::kReceive, rpdo);
  for (Tpdo& tpdo : tpdos_) {
    read_pdo(dictionary_, PdoDirection::kTransmit, tpdo);
    tpdo.not_before = now;
  }
  update_interest();
}

void Node::update_interest() {
  interest_.fill(0);
  any_extended_pdo_ = false;
  const auto add = [this](std::uint32_t id, Interest interest) {
    interest_[id & can::kMaxStandardId] = static_cast<std::uint8_t>(interest_[id & can::kMaxStandardId] | interest);
  };
  add(cob_id::kNmt, kNmt);
  add(sync_id_, kSync);
  add(cob_id::sdo_request(node_id_), kSdo);
  add(cob_id::heartbeat(node_id_), kGuard);
  for (const Rpdo& rpdo : rpdos_) {
    if (!rpdo.active) continue;
    rpdo.extended ? void(any_extended_pdo_ = true) : add(rpdo.id, kRpdo);
  }
  for (const Tpdo& tpdo : tpdos_) {
    if (!tpdo.active || !tpdo.remote_allowed) continue;
    tpdo.extended ? void(any_extended_pdo_ = true) : add(tpdo.id, kRemote);
  }
  for (std::uint8_t node = 1; node <= kMaxNodeId; ++node) {
    if (heartbeats_.is_watched(node)) add(cob_id::heartbeat(node), kHeartbeat);
  }
}

void Node::send_heartbeat_if_due(Instant now, Frames& out) {
  if (now < heartbeat_due_) return;
  out.push_back(make_heartbeat(node_id_, state_));
  heartbeat_due_ = next_on_grid(heartbeat_due_, heartbeat_period_, now);
}

void Node::read_heartbeat_consumers() {
  heartbeats_.clear();
  for (std::uint8_t sub = 1; sub <= kMaxConsumers; ++sub) {
    const OdEntry* const entry = dictionary_.find(0x1016, sub);
    if (entry == nullptr) return;
    replace_heartbeat_consumer(0, static_cast<std::uint32_t>(entry->to_int64()));
  }
}

void Node::replace_heartbeat_consumer(std::uint32_t old_value, std::uint32_t value) {
  if (is_in_use(old_value)) {
    heartbeats_.watch(heartbeat_node(old_value), Nanos{0});
    clear_emcy(emcy_code::kHeartbeat, heartbeat_node(old_value));
  }
  if (is_in_use(value)) heartbeats_.watch(heartbeat_node(value), heartbeat_time(value));
}

void Node::on_heartbeat_event(Instant now, const HeartbeatEvent& event, Frames& out) {
  if (event.change == HeartbeatChange::kBack) clear_emcy(emcy_code::kHeartbeat, event.node);
  listener_->on_heartbeat(now, event);
  if (event.change == HeartbeatChange::kLost) on_communication_lost(now, event.node, out);
}

void Node::on_communication_lost(Instant now, std::uint8_t instance, Frames& out) {
  raise_emcy(emcy_code::kHeartbeat, error_register::kCommunication, {instance});
  // Said before the reaction, because a node that stops may not say it any more.
  if (may_send_emcy()) emcy_.send_due(now, out);
  const std::int64_t reaction = dictionary_.integer_or(0x1029, 1, 0);
  if (reaction == 0 && state_ == NmtState::kOperational) set_state(now, NmtState::kPreOperational);
  if (reaction == 2) set_state(now, NmtState::kStopped);
}

void Node::on_guard_request(Instant now, Frames& out) {
  if (heartbeat_period_ > Nanos{0}) return;
  can::CanFrame answer = make_heartbeat(node_id_, state_);
  answer.bytes[0] |= guard_toggle_;
  guard_toggle_ ^= 0x80;
  out.push_back(answer);
  const Nanos life_time = 1ms * (dictionary_.integer_or(0x100C, 0, 0) * dictionary_.integer_or(0x100D, 0, 0));
  if (life_time > Nanos{0}) guard_expires_ = now + life_time;
  clear_emcy(emcy_code::kHeartbeat, std::uint8_t{0});
}

void Node::check_guarding(Instant now, Frames& out) {
  if (now < guard_expires_) return;
  guard_expires_ = Instant::never();
  on_communication_lost(now, 0, out);
}

void Node::read_sync_parameters(Instant now) {
  const auto cob_id = static_cast<std::uint32_t>(dictionary_.integer_or(0x1005, 0, cob_id::kSync));
  sync_id_ = cob_id & can::kMaxStandardId;
  sync_overflow_ = static_cast<std::uint8_t>(dictionary_.integer_or(0x1019, 0, 0));
  sync_window_ = 1us * dictionary_.integer_or(0x1007, 0, 0);
  const Nanos period = 1us * dictionary_.integer_or(0x1006, 0, 0);
  const bool produces = (cob_id & kSyncProducer) != 0 && period > Nanos{0};
  if (!produces) {
    sync_due_ = Instant::never();
  } else if (sync_due_ == Instant::never() || period != sync_period_) {
    sync_due_ = now + period;
    sync_counter_ = 0;
  }
  sync_period_ = period;
}

void Node::produce_sync_if_due(Instant now, Frames& out) {
  if (now < sync_due_) return;
  sync_due_ = next_on_grid(sync_due_, sync_period_, now);
  if (state_ == NmtState::kStopped) return;
  can::CanFrame frame;
  frame.id = sync_id_;
  if (sync_overflow_ > 1) {
    sync_counter_ = sync_counter_ >= sync_overflow_ ? std::uint8_t{1} : static_cast<std::uint8_t>(sync_counter_ + 1);
    frame.length = 1;
    frame.bytes[0] = sync_counter_;
  }
  out.push_back(frame);
  handle_sync(now, frame.bytes[0], out);
}

void Node::on_sync_frame(Instant now, const can::CanFrame& frame, Frames& out) {
  if (state_ == NmtState::kStopped) return;
  const std::uint8_t expected_length = sync_overflow_ > 1 ? 1 : 0;
  if (frame.length != expected_length) {
    return raise_emcy(emcy_code::kSyncLength, error_register::kCommunication, {0, frame.length});
  }
  if (emcy_.is_active(emcy_code::kSyncLength)) clear_emcy(emcy_code::kSyncLength);
  handle_sync(now, expected_length == 0 ? std::uint8_t{0} : frame.bytes[0], out);
}

void Node::handle_sync(Instant now, std::uint8_t counter, Frames& out) {
  last_sync_ = now;
  for (Rpdo& rpdo : rpdos_) {
    if (!rpdo.is_waiting) continue;
    rpdo.is_waiting = false;
    apply_rpdo(now, rpdo, rpdo.waiting.data());
  }
  listener_->on_sync(now, counter);
  if (state_ == NmtState::kOperational) send_synchronous_tpdos(now, counter, out);
}

void Node::arm_pdos(Instant now) {
  for (Tpdo& tpdo : tpdos_) arm_tpdo(now, tpdo);
}

void Node::arm_tpdo(Instant now, Tpdo& tpdo) {
  tpdo.event_pending = !tpdo.is_synchronous();  // Consumers get a first value without waiting for a change.
  tpdo.timer = tpdo.event_time > Nanos{0} ? now + tpdo.event_time : Instant::never();
  tpdo.syncs = 0;
  tpdo.waits_for_start = tpdo.sync_start != 0 && sync_overflow_ > 1;
}

void Node::disarm_pdos() {
  for (Rpdo& rpdo : rpdos_) {
    rpdo.is_waiting = false;
    rpdo.expires = Instant::never();
  }
  for (Tpdo& tpdo : tpdos_) tpdo.event_pending = false;
}

void Node::on_rpdo_frame(Instant now, const can::CanFrame& frame) {
  if (state_ != NmtState::kOperational) return;
  for (Rpdo& rpdo : rpdos_) {
    if (rpdo.active && rpdo.id == frame.id && rpdo.extended == frame.extended) receive_rpdo(now, rpdo, frame);
  }
}

void Node::receive_rpdo(Instant now, Rpdo& rpdo, const can::CanFrame& frame) {
  const auto instance = static_cast<std::uint8_t>(rpdo.number);
  if (frame.length < rpdo.mapping.length()) {
    const ManufacturerBytes detail{instance, frame.length, rpdo.mapping.length()};
    return raise_emcy(emcy_code::kPdoTooShort, error_register::kCommunication, detail);
  }
  if (emcy_.is_active(emcy_code::kPdoTooShort)) clear_emcy(emcy_code::kPdoTooShort, instance);
  if (emcy_.is_active(emcy_code::kRpdoTimeout)) clear_emcy(emcy_code::kRpdoTimeout, instance);
  rpdo.expires = rpdo.event_time > Nanos{0} ? now + rpdo.event_time : Instant::never();
  if (!rpdo.is_synchronous()) return apply_rpdo(now, rpdo, frame.bytes.data());

  const bool is_late = sync_window_ > Nanos{0} && now - last_sync_ > sync_window_;
  if (is_late) return;
  std::copy_n(frame.bytes.begin(), rpdo.waiting.size(), rpdo.waiting.begin());
  rpdo.is_waiting = true;
}

void Node::apply_rpdo(Instant now, Rpdo& rpdo, const std::uint8_t* bytes) {
  rpdo.mapping.scatter(bytes);
  listener_->on_rpdo(now, rpdo.number);
}

void Node::check_rpdo_deadlines(Instant now) {
  for (Rpdo& rpdo : rpdos_) {
    if (now < rpdo.expires) continue;
    rpdo.expires = Instant::never();
    raise_emcy(emcy_code::kRpdoTimeout, error_register::kCommunication, {static_cast<std::uint8_t>(rpdo.number)});
    listener_->on_rpdo_timeout(now, rpdo.number);
  }
}

void Node::send_tpdo(Instant now, Tpdo& tpdo, Frames& out) {
  listener_->before_tpdo(now, tpdo.number);
  can::CanFrame& frame = out.emplace_back();
  frame.id = tpdo.id;
  frame.extended = tpdo.extended;
  frame.length = tpdo.mapping.length();
  tpdo.mapping.gather(frame.bytes.data());
  tpdo.event_pending = false;
  tpdo.not_before = now + tpdo.inhibit_time;
  tpdo.timer = tpdo.event_time > Nanos{0} ? now + tpdo.event_time : Instant::never();
}

void Node::send_synchronous_tpdos(Instant now, std::uint8_t counter, Frames& out) {
  for (Tpdo& tpdo : tpdos_) {
    if (!tpdo.active || !tpdo.is_synchronous()) continue;
    if (tpdo.type == kSyncAcyclic) {
      if (tpdo.event_pending) send_tpdo(now, tpdo, out);
      continue;
    }
    if (tpdo.waits_for_start) {
      if (counter != tpdo.sync_start) continue;
      tpdo.waits_for_start = false;
      tpdo.syncs = static_cast<std::uint8_t>(tpdo.type - 1);  // The start value is the first of its cycle.
    }
    if (++tpdo.syncs < tpdo.type) continue;
    tpdo.syncs = 0;
    send_tpdo(now, tpdo, out);
  }
}

void Node::send_due_tpdos(Instant now, Frames& out) {
  for (Tpdo& tpdo : tpdos_) {
    if (!tpdo.active || tpdo.is_synchronous()) continue;
    if (now >= next_sending(tpdo.event_pending, tpdo.not_before, tpdo.timer)) send_tpdo(now, tpdo, out);
  }
}

void Node::on_remote_frame(Instant now, const can::CanFrame& frame, Frames& out) {
  if (!frame.extended && frame.id == cob_id::heartbeat(node_id_)) return on_guard_request(now, out);
  if (state_ != NmtState::kOperational) return;
  for (Tpdo& tpdo : tpdos_) {
    const bool is_asked = tpdo.active && tpdo.remote_allowed && !tpdo.is_synchronous() && tpdo.id == frame.id &&
                          tpdo.extended == frame.extended;
    if (is_asked) send_tpdo(now, tpdo, out);
  }
}

AbortCode Node::read(Instant now, ObjectAddress address, std::vector<std::uint8_t>& value) {
  if (const AbortCode code = dictionary_.check_read(address); code != AbortCode::kNone) return code;
  OdEntry& entry = dictionary_.at(address.index, address.sub);
  const bool is_empty_history = address.index == 0x1003 && address.sub > emcy_.history_count();
  if (is_empty_history) return AbortCode::kNoData;
  if (const AbortCode code = listener_->on_read(now, entry); code != AbortCode::kNone) return code;
  const auto bytes = entry.bytes();
  value.insert(value.end(), bytes.begin(), bytes.end());
  return AbortCode::kNone;
}

AbortCode Node::begin_write(ObjectAddress address, std::optional<std::size_t> size) {
  return dictionary_.check_write(address, size);
}

std::size_t Node::capacity(ObjectAddress address) {
  return dictionary_.at(address.index, address.sub).capacity();
}

AbortCode Node::write(Instant now, ObjectAddress address, std::span<const std::uint8_t> value) {
  if (const AbortCode code = dictionary_.check_write(address, value); code != AbortCode::kNone) return code;
  if (const AbortCode code = check_communication_write(address, value); code != AbortCode::kNone) return code;
  OdEntry& entry = dictionary_.at(address.index, address.sub);
  if (const AbortCode code = listener_->on_write(now, entry, value); code != AbortCode::kNone) return code;
  const bool is_command = address.sub > 0 && (address.index == 0x1010 || address.index == 0x1011);
  if (is_command) return execute_store_command(now, address, to_number(value));

  const auto old_value = static_cast<std::uint32_t>(entry.to_int64());
  entry.assign(value);
  apply_communication_write(now, address, old_value);
  listener_->on_written(now, entry);
  return AbortCode::kNone;
}

AbortCode Node::check_communication_write(ObjectAddress address, std::span<const std::uint8_t> value) {
  using enum AbortCode;
  const std::uint32_t number = to_number(value);
  const auto old_number = static_cast<std::uint32_t>(dictionary_.integer_or(address.index, address.sub, 0));
  const bool id_changes = ((number ^ old_number) & (kCobIdMask | kCobIdExtended)) != 0;
  const bool bad_id = (number & kCobIdExtended) != 0 || (number & kCobIdMask) > can::kMaxStandardId ||
                      cob_id::is_restricted(number & kCobIdMask);
  switch (address.index) {
    case 0x1003:
      return number == 0 ? kNone : kInvalidValue;
    case 0x1005:
      if (bad_id) return kInvalidValue;
      return id_changes && (old_number & kSyncProducer) != 0 ? kDeviceState : kNone;
    case 0x1014:
      if ((number & kPdoInvalid) != 0) return kNone;
      return bad_id || (id_changes && (old_number & kPdoInvalid) == 0) ? kInvalidValue : kNone;
    case 0x1016:
      return check_heartbeat_consumer(address, number);
    case 0x1019:
      if (number == 1 || number > kLastSyncCyclic) return kInvalidValue;
      return dictionary_.integer_or(0x1006, 0, 0) != 0 ? kDeviceState : kNone;
    case 0x1029:
      return address.sub > 0 && number > 2 ? kInvalidValue : kNone;
    default:
      break;
  }
  if (!is_pdo_object(address.index)) return kNone;
  return check_pdo_write(dictionary_, address, value);
}

AbortCode Node::check_heartbeat_consumer(ObjectAddress address, std::uint32_t value) const {
  if (!is_in_use(value)) return AbortCode::kNone;
  for (std::uint8_t sub = 1; sub <= kMaxConsumers; ++sub) {
    const OdEntry* const entry = dictionary_.find(0x1016, sub);
    if (entry == nullptr) break;
    const auto other = static_cast<std::uint32_t>(entry->to_int64());
    const bool is_twice = sub != address.sub && is_in_use(other) && heartbeat_node(other) == heartbeat_node(value);
    if (is_twice) return AbortCode::kIncompatible;
  }
  return AbortCode::kNone;
}

AbortCode Node::execute_store_command(Instant now, ObjectAddress address, std::uint32_t signature) {
  const bool is_save = address.index == 0x1010;
  if (signature != (is_save ? kSaveSignature : kLoadSignature)) return AbortCode::kCannotStore;
  const auto group = static_cast<ParameterGroup>(address.sub);
  if (group < ParameterGroup::kAll || group > ParameterGroup::kManufacturer) return AbortCode::kCannotStore;
  if (is_save) {
    parameters_.save(dictionary_, group);
  } else {
    parameters_.forget(group);  // The running values stay until the next reset.
  }
  listener_->on_stored(now);
  return AbortCode::kNone;
}

void Node::apply_communication_write(Instant now, ObjectAddress address, std::uint32_t old_value) {
  switch (address.index) {
    case 0x1003:
      return emcy_.clear_history();
    case 0x1005:
    case 0x1006:
    case 0x1007:
    case 0x1019:
      read_sync_parameters(now);
      return update_interest();
    case 0x1015:
      return emcy_.read_parameters();
    case 0x1016:
      replace_heartbeat_consumer(old_value, static_cast<std::uint32_t>(dictionary_.integer_or(0x1016, address.sub, 0)));
      return update_interest();
    case 0x1017:
      heartbeat_period_ = 1ms * dictionary_.integer_or(0x1017, 0, 0);
      heartbeat_due_ = heartbeat_period_ > Nanos{0} ? now : Instant::never();
      return;
    default:
      break;
  }
  if (is_pdo_object(address.index)) apply_pdo_write(now, address.index);
}

void Node::apply_pdo_write(Instant now, std::uint16_t index) {
  const unsigned number = 1U + (index & 0x1FFU);
  const bool is_receive = index < 0x1800;
  if (is_receive) {
    const auto rpdo = std::ranges::find(rpdos_, number, &Rpdo::number);
    if (rpdo == rpdos_.end()) return;
    read_pdo(dictionary_, PdoDirection::kReceive, *rpdo);
    rpdo->is_waiting = false;
    rpdo->expires = Instant::never();
  } else {
    const auto tpdo = std::ranges::find(tpdos_, number, &Tpdo::number);
    if (tpdo == tpdos_.end()) return;
    const bool was_active = tpdo->active;
    read_pdo(dictionary_, PdoDirection::kTransmit, *tpdo);
    if (state_ == NmtState::kOperational) {
      arm_tpdo(now, *tpdo);
      if (was_active) tpdo->event_pending = false;
    }
  }
  update_interest();
}

}  // namespace meltbench::canopen
