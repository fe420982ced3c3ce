#include "bench/bus/bus_node.hpp"

#include <linux/can/error.h>

#include <algorithm>

namespace meltbench::bus {

using can::ErrorState;
using can::Field;

namespace {

constexpr unsigned kWarningLevel = 96, kPassiveLevel = 128, kBusOffLevel = 256;
constexpr unsigned kHighestRec = 255;         // Beyond that it says nothing more; transceivers have 8 bits for it.
constexpr unsigned kRecAfterReception = 119;  // ISO 11898-1: to a value from 119 to 127, if it was above.
constexpr unsigned kFlagBits = 6, kDelimiterBits = 8, kSuspendBits = 8, kIdleBits = 11, kRecoveries = 128;

std::uint8_t type_of(BusError error) {
  switch (error) {
    case BusError::kBit0:
      return CAN_ERR_PROT_BIT0;
    case BusError::kBit1:
      return CAN_ERR_PROT_BIT1;
    case BusError::kStuff:
      return CAN_ERR_PROT_STUFF;
    case BusError::kForm:
      return CAN_ERR_PROT_FORM;
    case BusError::kCrc:
    case BusError::kAck:
      break;
  }
  return CAN_ERR_PROT_UNSPEC;
}

}  // namespace

BusNode::BusNode(std::size_t number, std::size_t tx_queue, TxOrder order, std::optional<Nanos> restart_after,
                 BusListener& listener)
    : number_{number}, restart_after_{restart_after}, listener_{&listener}, queue_{tx_queue, order} {}

bool BusNode::send(Instant now, const can::CanFrame& frame) {
  if (!is_off() && queue_.push(now, frame)) return true;
  ++counters_.tx_dropped;
  return false;
}

const Pending* BusNode::head(Instant at) const {
  return babbling_ ? &babble_ : queue_.head(at);
}

void BusNode::babble(const std::optional<can::CanFrame>& frame) {
  babbling_ = frame.has_value();
  if (frame) babble_ = Pending{*frame, can::arbitration_key(*frame), can::calc_frame_length(*frame), Instant{}};
}

const can::WireBit* BusNode::sending() const {
  return phase_ == Phase::kTransmit ? &wire_.bits()[position_] : nullptr;
}

bool BusNode::drive(Instant at) {
  acknowledging_ = false;
  switch (phase_) {
    case Phase::kIdle:
      if (head(at) == nullptr) return false;
      begin_transmit(at);
      return true;
    case Phase::kTransmit:
      return !wire_.bits()[position_].recessive;
    case Phase::kReceive:
      acknowledging_ = reader_.acknowledges();
      return acknowledging_;
    case Phase::kFlag:
      return !passive_flag_;
    default:
      return false;
  }
}

void BusNode::sample(Instant at, bool recessive) {
  switch (phase_) {
    case Phase::kOff:
    case Phase::kBusOff:
      return;
    case Phase::kRecovering:
      return sample_recovery(at, recessive);
    case Phase::kIntegrating:
      count_ = recessive ? count_ + 1 : 0;
      if (count_ == kIdleBits) enter(Phase::kIdle);
      return;
    case Phase::kIdle:
      if (!recessive) begin_receive();
      return;
    case Phase::kSuspend:
      if (!recessive) return begin_receive();
      if (++count_ == kSuspendBits) enter(Phase::kIdle);
      return;
    case Phase::kTransmit:
      return sample_transmit(at, recessive);
    case Phase::kReceive:
      return sample_receive(at, recessive);
    case Phase::kFlag:
      return sample_flag(at, recessive);
    case Phase::kAfterFlag:
      return sample_after_flag(at, recessive);
    case Phase::kDelimiter:
      return sample_delimiter(at, recessive);
    case Phase::kIntermission:
      return sample_intermission(at, recessive);
  }
}

void BusNode::begin_transmit(Instant at) {
  enter(Phase::kTransmit);
  sending_ = head(at);
  can::CanFrame frame = sending_->frame;
  if (frame.fd) frame.esi = frame.esi || state_ == ErrorState::kPassive;
  can::encode_frame(frame, wire_);
  position_ = 0;
  started_at_ = at;
  transmitter_ = true;
  reader_.reset();
}

void BusNode::begin_receive() {
  enter(Phase::kReceive);
  transmitter_ = false;
  reader_.reset();
  static_cast<void>(reader_.push(false));
}

void BusNode::sample_transmit(Instant at, bool recessive) {
  const can::WireBit bit = wire_.bits()[position_];
  const FrameReader::Verdict verdict = reader_.push(recessive);  // So that a loser goes on as a receiver.
  if (bit.field == Field::kAck) {
    if (recessive) return signal_error(at, BusError::kAck, bit.field);
  } else if (bit.recessive && !recessive) {
    if (!can::is_arbitration(bit.field)) return signal_error(at, BusError::kBit1, bit.field);
    // A stuff bit that somebody has pulled down is no fault of the sender: it does not count.
    if (bit.stuff) return signal_error(at, BusError::kStuff, bit.field, false);
    ++counters_.arbit_lost;
    transmitter_ = false;
    sending_ = nullptr;
    enter(Phase::kReceive);
    return handle_verdict(at, verdict, recessive);
  } else if (!bit.recessive && recessive) {
    return signal_error(at, BusError::kBit0, bit.field);
  }
  if (++position_ < wire_.bits().size()) return;
  const Pending sent = *sending_;
  finish_sent(at, *sending_);
  has_sent_ = sent;
  enter(Phase::kIntermission);
}

void BusNode::finish_sent(Instant at, const Pending& pending) {
  ++counters_.tx_packets;
  counters_.tx_bytes += pending.frame.data().size();
  sending_ = nullptr;
  if (&pending != &babble_) queue_.remove(pending);
  lower_tec(at);
}

void BusNode::count_received(std::uint64_t packets, std::uint64_t bytes) {
  counters_.rx_packets += packets;
  counters_.rx_bytes += bytes;
  rec_ -= static_cast<unsigned>(std::min<std::uint64_t>(rec_, packets));
}

void BusNode::sample_receive(Instant at, bool recessive) {
  const FrameReader::Verdict verdict = reader_.push(recessive);
  if (acknowledging_) {
    if (recessive) return signal_error(at, BusError::kBit0, Field::kAck);
    lower_rec(at);
  }
  handle_verdict(at, verdict, recessive);
}

void BusNode::handle_verdict(Instant at, FrameReader::Verdict verdict, bool recessive) {
  switch (verdict) {
    case FrameReader::Verdict::kGoesOn:
      return;
    case FrameReader::Verdict::kStuffError:
      return signal_error(at, BusError::kStuff, reader_.field());
    case FrameReader::Verdict::kFormError:
      return signal_error(at, BusError::kForm, reader_.field());
    case FrameReader::Verdict::kCrcError:
      return signal_error(at, BusError::kCrc, Field::kCrc);
    case FrameReader::Verdict::kFrame:
      has_received_ = true;
      ++counters_.rx_packets;
      counters_.rx_bytes += reader_.frame().data().size();
      // Dominant in the last bit comes too late to be an error for a receiver.
      return recessive ? enter(Phase::kIntermission) : begin_flag(true, false);
  }
}

void BusNode::signal_error(Instant at, BusError error, Field field, bool counts) {
  ++counters_.bus_errors;
  sending_ = nullptr;
  const bool as_sender = transmitter_;
  const bool passive = state_ == ErrorState::kPassive;
  begin_flag(false, passive);  // An error that makes it passive is still signalled actively.
  if (as_sender) {
    unheard_ = passive && error == BusError::kAck;  // Counts only if somebody else signals an error, too.
    if (counts && !unheard_) raise_tec(at, 8);
  } else {
    raise_rec(at, 1);
  }
  report_error(at, error, field, as_sender);
}

void BusNode::begin_flag(bool overload, bool passive) {
  enter(Phase::kFlag);
  overload_ = overload;
  passive_flag_ = passive;
  unheard_ = false;
  run_ = 0;
}

void BusNode::sample_flag(Instant at, bool recessive) {
  if (!passive_flag_) {
    if (recessive) {  // A bit error in its own flag: it counts, and the flag begins anew.
      begin_flag(overload_, state_ == ErrorState::kPassive && !overload_);
      return raise(at, 8);
    }
    if (++count_ == kFlagBits) enter(Phase::kAfterFlag);
    return;
  }
  if (unheard_ && !recessive) {
    unheard_ = false;
    raise_tec(at, 8);
    if (is_off()) return;
  }
  run_ = run_ > 0 && recessive == run_level_ ? run_ + 1 : 1;
  run_level_ = recessive;
  if (run_ == kFlagBits) enter(Phase::kAfterFlag);
}

void BusNode::sample_after_flag(Instant at, bool recessive) {
  if (recessive) {
    enter(Phase::kDelimiter);
    count_ = 1;
    return;
  }
  ++count_;
  if (count_ == 1 && !overload_ && !transmitter_)
    raise_rec(at, 8);  // Others have answered: it was the first to see it.
  if (count_ % 8 == 0) raise(at, 8);
}

void BusNode::sample_delimiter(Instant at, bool recessive) {
  if (recessive) {
    if (++count_ == kDelimiterBits) enter(Phase::kIntermission);
  } else if (count_ + 1 < kDelimiterBits) {
    signal_error(at, BusError::kForm, Field::kNone);
  } else {
    begin_flag(true, false);
  }
}

void BusNode::sample_intermission(Instant at, bool recessive) {
  ++count_;
  if (!recessive && count_ < can::kIntermissionBits) return begin_flag(true, false);
  if (count_ < can::kIntermissionBits) return;
  const bool suspended = transmitter_ && state_ == ErrorState::kPassive;  // Lets the others go first.
  transmitter_ = false;
  if (recessive) return enter(suspended ? Phase::kSuspend : Phase::kIdle);
  // Somebody began one bit early: that is a start of frame, and who has something to send goes on with the identifier.
  if (suspended || head(at) == nullptr) return begin_receive();
  begin_transmit(at);
  static_cast<void>(reader_.push(false));
  position_ = 1;
}

void BusNode::sample_recovery(Instant at, bool recessive) {
  run_ = recessive ? run_ + 1 : 0;
  if (run_ < kIdleBits) return;
  run_ = 0;
  if (++count_ < kRecoveries) return;
  tec_ = rec_ = 0;
  enter(Phase::kIdle);
  update_state(at);
}

void BusNode::force_bus_off(Instant at) {
  if (is_off() || phase_ == Phase::kRecovering) return;
  tec_ = kBusOffLevel;
  enter_bus_off(at);
}

void BusNode::restart_at(Instant at) {
  if (phase_ == Phase::kBusOff) restart_at_ = at;
}

void BusNode::restart_if_due(Instant now) {
  if (restart_at_ > now) return;
  restart_at_ = Instant::never();
  ++counters_.re_started;
  enter(Phase::kRecovering);
  run_ = 0;
  report(now, CAN_ERR_RESTARTED, 0);
}

void BusNode::set_powered(bool on) {
  if (on != (phase_ == Phase::kOff)) return;
  counters_.tx_dropped += queue_.size();
  queue_.clear();
  sending_ = nullptr;
  tec_ = rec_ = level_ = 0;
  state_ = ErrorState::kActive;
  restart_at_ = Instant::never();
  enter(on ? Phase::kIntegrating : Phase::kOff);
}

void BusNode::raise(Instant at, unsigned by) {
  transmitter_ ? raise_tec(at, by) : raise_rec(at, by);
}

void BusNode::raise_tec(Instant at, unsigned by) {
  tec_ += by;
  if (tec_ >= kBusOffLevel) return enter_bus_off(at);
  update_state(at);
}

void BusNode::raise_rec(Instant at, unsigned by) {
  rec_ = std::min(rec_ + by, kHighestRec);
  update_state(at);
}

void BusNode::lower_tec(Instant at) {
  if (tec_ == 0) return;
  --tec_;
  update_state(at);
}

void BusNode::lower_rec(Instant at) {
  if (rec_ == 0) return;
  rec_ = rec_ >= kPassiveLevel ? kRecAfterReception : rec_ - 1;
  update_state(at);
}

void BusNode::update_state(Instant at) {
  const unsigned worst = std::max(tec_, rec_);
  const unsigned level = worst >= kPassiveLevel ? 2 : worst >= kWarningLevel ? 1 : 0;
  const ErrorState state = level == 2 ? ErrorState::kPassive : ErrorState::kActive;
  if (level != level_) {
    if (level > level_) ++(level == 2 ? counters_.error_pass : counters_.error_warn);
    level_ = level;
    report(at, CAN_ERR_CRTL, describe_level());
  }
  if (state == state_) return;
  state_ = state;
  listener_->on_state(at, number_, state);
}

std::uint8_t BusNode::describe_level() const {
  if (level_ == 0) return CAN_ERR_CRTL_ACTIVE;
  const unsigned limit = level_ == 1 ? kWarningLevel : kPassiveLevel;
  unsigned status = 0;
  if (tec_ >= limit) status |= level_ == 1 ? CAN_ERR_CRTL_TX_WARNING : CAN_ERR_CRTL_TX_PASSIVE;
  if (rec_ >= limit) status |= level_ == 1 ? CAN_ERR_CRTL_RX_WARNING : CAN_ERR_CRTL_RX_PASSIVE;
  return static_cast<std::uint8_t>(status);
}

void BusNode::enter_bus_off(Instant at) {
  enter(Phase::kBusOff);
  ++counters_.bus_off;
  counters_.tx_dropped += queue_.size();
  queue_.clear();
  sending_ = nullptr;
  transmitter_ = false;
  state_ = ErrorState::kBusOff;
  level_ = 3;
  restart_at_ = restart_after_ ? at + *restart_after_ : Instant::never();
  report(at, CAN_ERR_BUSOFF, 0);
  listener_->on_state(at, number_, state_);
}

void BusNode::report_error(Instant at, BusError error, Field field, bool as_sender) {
  can::CanFrame frame;
  frame.kind = can::FrameKind::kError;
  frame.id = CAN_ERR_BUSERROR | CAN_ERR_PROT | CAN_ERR_CNT;
  if (error == BusError::kAck) frame.id |= CAN_ERR_ACK;
  frame.length = CAN_ERR_DLC;
  frame.bytes[2] = type_of(error);
  if (as_sender) frame.bytes[2] |= CAN_ERR_PROT_TX;
  frame.bytes[3] = static_cast<std::uint8_t>(field);
  frame.bytes[6] = static_cast<std::uint8_t>(std::min(tec_, 255U));
  frame.bytes[7] = static_cast<std::uint8_t>(rec_);
  listener_->on_error(at, number_, frame);
}

void BusNode::report(Instant at, std::uint32_t error_class, std::uint8_t controller_status) {
  can::CanFrame frame;
  frame.kind = can::FrameKind::kError;
  frame.id = error_class | CAN_ERR_CNT;
  frame.length = CAN_ERR_DLC;
  frame.bytes[1] = controller_status;
  frame.bytes[6] = static_cast<std::uint8_t>(std::min(tec_, 255U));
  frame.bytes[7] = static_cast<std::uint8_t>(rec_);
  listener_->on_error(at, number_, frame);
}

}  // namespace meltbench::bus
