#include "protocols/modbus/rtu_client.hpp"

#include <algorithm>

namespace meltbench::modbus {

void RtuClient::send(Instant now, std::uint8_t unit, const Pdu& request, std::vector<std::uint8_t>& out) {
  unit_ = unit;
  request_ = request;
  attempts_ = 0;
  phase_ = Phase::kHeld;
  if (now >= quiet_at_) transmit(now, out);
}

void RtuClient::transmit(Instant now, std::vector<std::uint8_t>& out) {
  append_frame(unit_, request_.bytes(), out);
  ++attempts_;
  reader_.reset();
  request_end_ = now + timing_.on_wire(frame_size(request_.size()));
  quiet_at_ = request_end_ + timing_.t3_5;
  give_up_at_ = request_end_ + (unit_ == kBroadcast ? times_.broadcast_turnaround : times_.answer_timeout);
  phase_ = Phase::kWaiting;
}

void RtuClient::on_bytes(Instant at, std::span<const std::uint8_t> bytes) {
  quiet_at_ = std::max(quiet_at_, at + timing_.t3_5);
  while (!bytes.empty()) {
    bytes = bytes.subspan(reader_.take(at, bytes));
    if (const auto frame = reader_.take_frame()) handle(at, *frame);
  }
}

void RtuClient::handle(Instant at, const Frame& frame) {
  const bool expected =
      phase_ == Phase::kWaiting && unit_ != kBroadcast && frame.unit == unit_ && fits(request_.bytes(), frame.pdu);
  if (!expected) {
    ++rejected_;
    return;
  }
  answer_.clear();
  answer_.push_bytes(frame.pdu);
  const bool refused = exception_of(frame.pdu) != ExceptionCode::kNone;
  conclude(refused ? ClientResult::Outcome::kException : ClientResult::Outcome::kAnswer, at);
}

void RtuClient::conclude(ClientResult::Outcome outcome, Instant at) {
  result_ = {.outcome = outcome,
             .exception = exception_of(answer_.bytes()),
             .answer = answer_.bytes(),
             .request_end = request_end_,
             .at = at,
             .attempts = attempts_};
  phase_ = Phase::kDone;
}

void RtuClient::on_time(Instant now, std::vector<std::uint8_t>& out) {
  reader_.on_time(now);
  if (const auto frame = reader_.take_frame()) handle(now, *frame);
  if (phase_ == Phase::kWaiting && now >= give_up_at_) {
    answer_.clear();
    if (unit_ == kBroadcast) return conclude(ClientResult::Outcome::kBroadcastDone, now);
    ++timeouts_;
    if (attempts_ > times_.retries) return conclude(ClientResult::Outcome::kTimeout, now);
    phase_ = Phase::kHeld;
  }
  if (phase_ == Phase::kHeld && now >= quiet_at_) transmit(now, out);
}

Instant RtuClient::next_deadline() const {
  Instant next = reader_.next_deadline();
  if (phase_ == Phase::kHeld) next = std::min(next, quiet_at_);
  if (phase_ == Phase::kWaiting) next = std::min(next, give_up_at_);
  return next;
}

std::optional<ClientResult> RtuClient::take_result() {
  if (phase_ != Phase::kDone) return {};
  phase_ = Phase::kIdle;
  return result_;
}

}  // namespace meltbench::modbus
