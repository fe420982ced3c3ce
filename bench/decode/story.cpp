#include "bench/decode/story.hpp"

#include <fmt/format.h>
#include <linux/can/error.h>

#include <algorithm>
#include <cmath>

#include "protocols/can/frame_length.hpp"
#include "protocols/canopen/emcy.hpp"
#include "protocols/canopen/sdo.hpp"

namespace meltbench::decode {
namespace {

constexpr double kGapPeriods = 2.5;  // As consumers of heartbeats usually wait.
// Tenths of a period within which a regular frame is too early. Of two senders of heartbeats one always is.
constexpr std::int64_t kSoon = 4, kSoonHeartbeat = 6;
constexpr Nanos kRow = 1s;                    // Equal things closer than this are one finding.
constexpr Nanos kMessageRow = 10s;            // Frames of one message of a DBC closer than this are one finding.
constexpr Nanos kSetPointRow = 500ms;         // Changes of a set point closer than this are one finding.
constexpr double kSmallChange = 0.02;         // Of the value: a loop at work,
constexpr Nanos kSmallChangeRow = 10s;        // whose changes may be so far apart.
constexpr unsigned kMoves = 10;               // A set point that changes in so many frames in a row moves.
constexpr Nanos kResetTakes = 2s;             // A boot-up so soon after the master's reset is its effect.
constexpr Nanos kAnswerWithin = 1s;           // An SDO server that has not answered by then does not.
constexpr std::size_t kMaxSeconds = 1 << 22;  // Of load: 48 days.
constexpr double kLeastSecond = 0.5;          // A shorter rest at the end says nothing about the load.
constexpr std::uint16_t kInputStatus = 0x6150;
constexpr std::uint32_t kErrorClasses = 0xFFF;  // Of an error frame's identifier that say what it was.
constexpr std::uint32_t kDestroyed = CAN_ERR_PROT | CAN_ERR_BUSERROR | CAN_ERR_ACK;

/// Median of the gaps, if they are alike; one odd one among five is forgiven on either side.
std::optional<std::int64_t> regular_period(std::array<std::int64_t, 5> gaps) {
  std::ranges::sort(gaps);
  const std::int64_t median = gaps[2];
  const bool is_regular = median > 0 && 2 * gaps[1] >= median && 2 * gaps[3] <= 3 * median;
  return is_regular ? std::optional{median} : std::nullopt;
}

std::string describe_status(std::uint16_t status) {
  std::string words;
  const auto add = [&](unsigned bit, std::string_view word) {
    if ((status & bit) != 0) words += fmt::format("{}{}", words.empty() ? "" : ", ", word);
  };
  add(1, "not valid");
  add(2, "above its range");
  add(4, "below its range");
  return words.empty() ? fmt::format("status {:02X}h", status) : words;
}

std::string describe_error_class(std::uint32_t id) {
  std::string words;
  const auto add = [&](unsigned bit, std::string_view word) {
    if ((id & bit) != 0) words += fmt::format("{}{}", words.empty() ? "" : ", ", word);
  };
  add(CAN_ERR_PROT, "protocol error");
  add(CAN_ERR_ACK, "no acknowledge");
  add(CAN_ERR_LOSTARB, "arbitration lost");
  add(CAN_ERR_CRTL, "controller's warning");
  add(CAN_ERR_TRX, "transceiver");
  add(CAN_ERR_TX_TIMEOUT, "transmit time-out");
  return words.empty() ? "bus error" : words;
}

std::uint64_t value_key(std::uint32_t id, canopen::ObjectAddress address) {
  return std::uint64_t{id} << 24U | std::uint64_t{address.index} << 8U | address.sub;
}

}  // namespace

Story::Story(const config::Rig& rig, const Dbc* dbc)
    : view_{rig, dbc},
      bit_time_{1'000'000'000LL / rig.bus.bit_rate_bit_per_s},
      data_bit_time_{1'000'000'000LL / rig.bus.data_bit_rate_bit_per_s},
      controller_id_{rig.controller_node_id} {
  known_nodes_.push_back(rig.controller_node_id);
  for (const config::RigBoard& board : rig.boards) {
    if (board.node_id != 0) known_nodes_.push_back(board.node_id);
  }
}

Finding* Story::add(Finding finding) {
  if (findings_.size() >= kMaxFindings) {
    ++left_out_;
    spare_ = std::move(finding);
    return &spare_;
  }
  findings_.push_back(std::move(finding));
  return &findings_.back();
}

/// Adds, and notes where it is, for what comes later of the same.
Finding* Story::open(std::size_t& place, Finding finding) {
  place = findings_.size() < kMaxFindings ? findings_.size() : kNone;
  return add(std::move(finding));
}

void Story::take(Instant at, const can::CanFrame& frame) {
  now_ = std::max(now_, at);
  ++frames_;
  if (frame.kind == can::FrameKind::kError) return on_error(frame);
  add_load(frame);
  if (error_row_ != kNone && !came_through_) findings_[error_row_].after = to_s(now_ - *findings_[error_row_].until);
  came_through_ = true;
  last_frame_ = now_;
  if (frame.extended || frame.kind != can::FrameKind::kData) return on_unknown(frame);
  view_.take(frame);
  if (view_.find_message(frame) != nullptr) return on_unknown(frame);
  const FrameMeaning meaning = view_.meaning_of(frame);
  const bool is_known = meaning.node == 0 || std::ranges::find(known_nodes_, meaning.node) != known_nodes_.end();
  if (meaning.service == Service::kOther || !is_known) on_unknown(frame);
  switch (meaning.service) {
    case Service::kNmt:
      return on_nmt(frame);
    case Service::kSync:
      return follow_cycle(meaning, frame.id);
    case Service::kEmcy:
      return on_emcy(meaning, frame);
    case Service::kTpdo:
      on_measurements(meaning, frame);
      if (meaning.is_cyclic) follow_cycle(meaning, frame.id);
      return;
    case Service::kRpdo:
      return on_set_points(meaning, frame);
    case Service::kSdoRequest:
    case Service::kSdoResponse:
      return on_sdo(meaning, frame);
    case Service::kHeartbeat:
      return on_heartbeat(meaning, frame);
    case Service::kOther:
      return;
  }
}

void Story::on_nmt(const can::CanFrame& frame) {
  if (frame.length < 2) return;
  const auto order = static_cast<std::uint16_t>(frame.bytes[0] << 8U | frame.bytes[1]);
  if (nmt_ != kNone && findings_[nmt_].code == order && now_ - *findings_[nmt_].until <= kRow) {
    ++findings_[nmt_].count;
    findings_[nmt_].until = now_;
  } else {
    open(nmt_, {.kind = FindingKind::kNmt,
                .at = now_,
                .until = now_,
                .id = frame.id,
                .code = order,
                .text = view_.describe(frame)});
  }
  const auto command = static_cast<canopen::NmtCommand>(frame.bytes[0]);
  const bool is_reset =
      command == canopen::NmtCommand::kResetNode || command == canopen::NmtCommand::kResetCommunication;
  for (const std::uint8_t id : known_nodes_) {
    if (frame.bytes[1] != 0 && frame.bytes[1] != id) continue;
    if (is_reset) nodes_[id].reset_asked = now_;
    if (command != canopen::NmtCommand::kStart) forget_cycles(id, is_reset);
  }
}

void Story::on_heartbeat(const FrameMeaning& meaning, const can::CanFrame& frame) {
  if (frame.length != 1) return;
  Node& node = nodes_[meaning.node];
  const auto state = static_cast<std::uint8_t>(frame.bytes[0] & 0x7FU);
  if (state == 0) {
    const bool is_first = node.state == 0xFF;
    const bool is_asked = is_first || now_ - node.reset_asked <= kResetTakes;
    const std::string who = view_.name_of(meaning.node);
    add({.kind = FindingKind::kBoot,
         .at = now_,
         .node = meaning.node,
         .id = frame.id,
         .code = static_cast<std::uint16_t>(is_asked ? 0 : 1),
         .text = is_asked ? who + " boots up"
                          : who + " boots up although nobody has asked for it: it was reset, or lost power"});
    forget_cycles(meaning.node, true);
    node.state = state;
    return;
  }
  follow_cycle(meaning, frame.id);
  if (state != node.state) {
    add({.kind = FindingKind::kState,
         .at = now_,
         .node = meaning.node,
         .code = state,
         .text = fmt::format("{} is {}", view_.name_of(meaning.node), text(static_cast<canopen::NmtState>(state)))});
  }
  node.state = state;
}

void Story::on_emcy(const FrameMeaning& meaning, const can::CanFrame& frame) {
  const auto emcy = canopen::parse_emcy(frame);
  if (!emcy) return;
  Node& node = nodes_[meaning.node];
  if (node.emcy != kNone) {
    Finding& row = findings_[node.emcy];
    if (row.code == emcy->emcy.code && now_ - *row.until <= kRow) {
      ++row.count;
      row.until = now_;
      return;
    }
  }
  std::string text = emcy->emcy.code == 0 ? fmt::format("{} EMCY 0000h: an error is over", view_.name_of(meaning.node))
                                          : view_.describe(frame);
  text += fmt::format(" (error register {:02X}h)", emcy->emcy.error_register);
  open(node.emcy, {.kind = FindingKind::kEmcy,
                   .at = now_,
                   .until = now_,
                   .node = meaning.node,
                   .id = frame.id,
                   .code = emcy->emcy.code,
                   .text = std::move(text)});
}

// --- SDO

void Story::on_sdo(const FrameMeaning& meaning, const can::CanFrame& frame) {
  if (frame.length != 8) return;
  const bool is_request = meaning.service == Service::kSdoRequest;
  Talk& talk = nodes_[meaning.node].talk;
  const unsigned command = frame.bytes[0] >> 5U;
  if (frame.bytes[0] == 0x80) {
    const auto code = static_cast<canopen::AbortCode>(canopen::load<std::uint32_t>(frame.data(), 4));
    const std::string who = is_request ? std::string{"the master"} : view_.name_of(meaning.node);
    add({.kind = FindingKind::kSdoFailed,
         .at = now_,
         .node = meaning.node,
         .id = frame.id,
         .address = canopen::sdo_address(frame.bytes),
         .text = fmt::format("SDO {} of {}: aborted by {} with {:08X}, {}", text(canopen::sdo_address(frame.bytes)),
                             view_.name_of(meaning.node), who, static_cast<std::uint32_t>(code), text(code))});
    talk.request.reset();
    return;
  }
  if (!is_request) {
    talk.request.reset();
    if (talk.group != kNone) findings_[talk.group].until = now_;
    return;
  }
  // Initiate download, upload, block upload (the request that opens it), block download. The rest are segments.
  const bool begins = command == 1 || command == 2 || (command == 5 && (frame.bytes[0] & 3U) == 0) ||
                      (command == 6 && (frame.bytes[0] & 1U) == 0);
  if (!begins) return;
  if (talk.request) fail_request(meaning.node, talk, "no answer");
  talk.request = frame;
  talk.asked_at = now_;
  if (talk.group != kNone && now_ - *findings_[talk.group].until <= kRow) {
    ++findings_[talk.group].count;
    return;
  }
  open(talk.group, {.kind = FindingKind::kSdo,
                    .at = now_,
                    .until = now_,
                    .node = meaning.node,
                    .id = frame.id,
                    .text = fmt::format("SDO dialogue with {}", view_.name_of(meaning.node))});
}

void Story::fail_request(std::uint8_t node, Talk& talk, const std::string& why) {
  const canopen::ObjectAddress address = canopen::sdo_address(talk.request->bytes);
  add({.kind = FindingKind::kSdoFailed,
       .at = talk.asked_at,
       .node = node,
       .id = talk.request->id,
       .address = address,
       .text = fmt::format("SDO {} of {}: {}", text(address), view_.name_of(node), why)});
  talk.request.reset();
}

// --- values

void Story::on_set_points(const FrameMeaning& meaning, const can::CanFrame& frame) {
  for (const DecodedValue& value : view_.values_of(frame)) {
    const auto [place, is_first] = values_.try_emplace(value_key(frame.id, value.address));
    Value& known = place->second;
    if (!is_first && known.last == value.value) {
      known.in_a_row = 0;
      continue;
    }
    const double before = is_first ? value.value : known.last;
    known.last = value.value;
    ++known.in_a_row;
    const auto moves = static_cast<std::uint16_t>(known.in_a_row >= kMoves ? 1 : 0);
    if (known.finding != kNone) {
      Finding& row = findings_[known.finding];
      const bool is_small = std::abs(value.value - before) <= kSmallChange * std::abs(before);
      if (now_ - *row.until <= (is_small ? kSmallChangeRow : kSetPointRow)) {
        ++row.count;
        row.until = now_;
        row.code = moves;
        row.after = value.value;
        continue;
      }
    }
    open(known.finding, {.kind = FindingKind::kSetPoint,
                         .at = now_,
                         .until = now_,
                         .node = meaning.node,
                         .id = frame.id,
                         .address = value.address,
                         .before = before,
                         .after = value.value,
                         .text = fmt::format("to {}: {}", view_.name_of(meaning.node), value.name)});
  }
}

void Story::on_measurements(const FrameMeaning& meaning, const can::CanFrame& frame) {
  for (const DecodedValue& value : view_.values_of(frame)) {
    if (value.address.index != kInputStatus) continue;
    const auto status = static_cast<std::uint16_t>(value.value);
    Value& known = values_[value_key(frame.id, value.address)];
    if (known.last == value.value) continue;
    known.last = value.value;
    if (known.finding != kNone) findings_[known.finding].until = now_;
    known.finding = kNone;
    if (status == 0) continue;
    open(known.finding,
         {.kind = FindingKind::kInvalid,
          .at = now_,
          .node = meaning.node,
          .id = frame.id,
          .code = status,
          .address = value.address,
          .text = fmt::format("{}: {} is {}", view_.name_of(meaning.node), value.name, describe_status(status))});
  }
}

// --- what does not come, comes too often, or should not come

void Story::follow_cycle(const FrameMeaning& meaning, std::uint32_t id) {
  const auto [place, is_first] = cycles_.try_emplace(id);
  Cycle& cycle = place->second;
  cycle.node = meaning.node;
  if (cycle.seen > 0) {
    const Nanos gap = now_ - cycle.last;
    const auto period = cycle.seen > cycle.gaps_ns.size() ? regular_period(cycle.gaps_ns) : std::nullopt;
    const bool is_heartbeat = meaning.service == Service::kHeartbeat;
    const std::int64_t soon = is_heartbeat ? kSoonHeartbeat : kSoon;
    if (period && 10 * gap.count() < soon * *period) return take_early(cycle, meaning, id, Nanos{*period});
    if (tell_gap(cycle, id, now_)) cycle.back_at = now_;
    cycle.gaps_ns[cycle.seen % cycle.gaps_ns.size()] = gap.count();
  }
  ++cycle.seen;
  cycle.last = now_;
}

/// A frame that comes much too early is none of the row that is followed: it teaches nothing, unless it is the row that
/// has changed. What had to wait while the bus was dead comes at once, and is no second sender.
void Story::take_early(Cycle& cycle, const FrameMeaning& meaning, std::uint32_t id, Nanos period) {
  const bool has_own_time = meaning.service == Service::kSync || meaning.service == Service::kHeartbeat;
  if (!has_own_time || now_ - cycle.back_at <= kRow) return;
  if (cycle.early != kNone && now_ - *findings_[cycle.early].until <= kRow) {
    ++findings_[cycle.early].count;
    findings_[cycle.early].until = now_;
    return;
  }
  const Nanos gap = now_ - cycle.last;
  // The one before was the stranger's, if both gaps together are the period.
  const Nanos both = gap + Nanos{cycle.gaps_ns[(cycle.seen - 1) % cycle.gaps_ns.size()]};
  const bool was_stranger = std::chrono::abs(both - period) < period / 10;
  const std::string who = meaning.service == Service::kSync ? "SYNC" : view_.name_of(meaning.node) + " heartbeat";
  open(cycle.early,
       {.kind = FindingKind::kTooOften,
        .at = was_stranger ? cycle.last : now_,
        .until = now_,
        .node = meaning.node,
        .id = id,
        .before = to_s(period),
        .text = fmt::format("{} comes too often, {:.6g} ms after the one before: two senders?", who, to_s(gap) * 1e3)});
}

/// @returns whether there was one.
bool Story::tell_gap(Cycle& cycle, std::uint32_t id, std::optional<Instant> until) {
  if (cycle.seen <= cycle.gaps_ns.size()) return false;
  const auto period = regular_period(cycle.gaps_ns);
  const Nanos gap = until.value_or(now_) - cycle.last;
  if (!period || static_cast<double>(gap.count()) <= kGapPeriods * static_cast<double>(*period)) return false;
  can::CanFrame sample;
  sample.id = id;
  const FrameMeaning meaning = view_.meaning_of(sample);
  const bool is_heartbeat = meaning.service == Service::kHeartbeat;
  std::string what = "SYNC";
  if (is_heartbeat) what = view_.name_of(cycle.node) + " heartbeat";
  if (meaning.service == Service::kTpdo) what = fmt::format("{} TPDO{}", view_.name_of(cycle.node), meaning.number);
  add({.kind = is_heartbeat ? FindingKind::kHeartbeatLost : FindingKind::kGap,
       .at = cycle.last,
       .until = until,
       .node = cycle.node,
       .id = id,
       .before = to_s(Nanos{*period}),
       .text = std::move(what)});
  return true;
}

/// What a node does after a reset, or as a state allows, says nothing about before.
void Story::forget_cycles(std::uint8_t node, bool with_heartbeat) {
  for (auto& [id, cycle] : cycles_) {
    if (cycle.node != node || cycle.seen == 0) continue;
    const bool is_heartbeat = id == canopen::cob_id::heartbeat(node);
    if (is_heartbeat && !with_heartbeat) continue;
    tell_gap(cycle, id, now_);
    cycle.seen = 0;
  }
}

void Story::on_unknown(const can::CanFrame& frame) {
  const std::uint32_t key = frame.id | (frame.extended ? 0x8000'0000U : 0U);
  if (unknown_.size() >= kMaxFindings && !unknown_.contains(key)) {  // Nonsense; memory has its bounds.
    ++left_out_;
    return;
  }
  const DbcMessage* const message = view_.find_message(frame);
  const auto [place, is_first] = unknown_.try_emplace(key, kNone);
  if (place->second != kNone && now_ - *findings_[place->second].until <= (message == nullptr ? kRow : kMessageRow)) {
    ++findings_[place->second].count;
    findings_[place->second].until = now_;
    return;
  }
  open(place->second, {.kind = message == nullptr ? FindingKind::kUnknown : FindingKind::kMessage,
                       .at = now_,
                       .until = now_,
                       .id = frame.id,
                       .text = message == nullptr ? fmt::format("identifier {:03X}h is nobody's of this rig", frame.id)
                                                  : fmt::format("message {} ({:03X}h)", message->name, frame.id)});
}

void Story::on_error(const can::CanFrame& frame) {
  const auto tell = [&](std::uint16_t code, std::string_view text) {
    std::size_t& row = states_.at(code);
    if (row != kNone && now_ - *findings_[row].until <= kRow) {
      ++findings_[row].count;
      findings_[row].until = now_;
      return;
    }
    open(row, {.kind = FindingKind::kErrorState,
               .at = now_,
               .until = now_,
               .id = frame.id,
               .code = code,
               .text = std::string{text}});
  };
  if ((frame.id & CAN_ERR_BUSOFF) != 0) return tell(1, "bus-off");
  if ((frame.id & CAN_ERR_RESTARTED) != 0) return tell(2, "restarted after bus-off");
  if ((frame.id & CAN_ERR_CRTL) != 0 && (frame.bytes[1] & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0) {
    return tell(3, "error-passive");
  }
  const bool came_between = came_through_ && error_row_ != kNone && now_ - *findings_[error_row_].until <= kRow;
  std::size_t& row = errors_.try_emplace(frame.id & kErrorClasses, kNone).first->second;
  if (row != kNone && now_ - *findings_[row].until <= kRow) {
    ++findings_[row].count;
    findings_[row].until = now_;
  } else {
    open(row, {.kind = FindingKind::kErrorFrames,
               .at = now_,
               .until = now_,
               .id = frame.id,
               .before = to_s(now_ - last_frame_),
               .text = fmt::format("error frame: {}", describe_error_class(frame.id))});
  }
  if (row == kNone) return;
  // No receiver of a healthy wire sees a dominant bit that it sends come back as recessive.
  const bool has_lost_bit = (frame.id & CAN_ERR_PROT) != 0 && (frame.bytes[2] & CAN_ERR_PROT_BIT0) != 0;
  findings_[row].code |= static_cast<std::uint16_t>((has_lost_bit ? 1 : 0) | (came_between ? 2 : 0));
  if ((frame.id & kDestroyed) == 0) return;  // A counter has risen.
  error_row_ = row;
  came_through_ = false;
}

void Story::add_load(const can::CanFrame& frame) {
  const auto second = static_cast<std::size_t>(now_.since_start / 1s);
  if (second >= kMaxSeconds) return;
  if (second >= busy_ns_.size()) busy_ns_.resize(second + 1);
  const Nanos on_wire = can::time_on_wire(can::calc_frame_length(frame), bit_time_, data_bit_time_);
  busy_ns_[second] += (on_wire + can::kIntermissionBits * bit_time_).count();
}

// --- the end

void Story::finish() {
  for (auto& [id, cycle] : cycles_) {
    if (cycle.seen > 0) tell_gap(cycle, id, std::nullopt);
  }
  for (const std::uint8_t id : known_nodes_) {
    Talk& talk = nodes_[id].talk;
    if (talk.request && now_ - talk.asked_at > kAnswerWithin) fail_request(id, talk, "no answer");
  }
  absorb_gaps();
  for (Finding& finding : findings_) word(finding);
  std::ranges::stable_sort(findings_, {}, &Finding::at);
  std::int64_t total = 0;
  for (std::size_t second = 0; second < busy_ns_.size(); ++second) {
    total += busy_ns_[second];
    const double share = std::min(1.0, to_s(now_) - static_cast<double>(second));
    if (share < kLeastSecond) break;
    load_.per_second.push_back(static_cast<float>(static_cast<double>(busy_ns_[second]) / 1e9 / share));
  }
  if (now_ > Instant{}) load_.mean = static_cast<double>(total) / static_cast<double>(now_.since_start.count());
}

/// Frames are not missed of a node that is silent, nor answers to a SYNC that does not come. The silences of one node
/// follow one another, so each gap finds the one that it may belong to by its time.
void Story::absorb_gaps() {
  const auto end_of = [this](const Finding& finding) { return finding.until.value_or(now_); };
  std::array<std::vector<std::size_t>, 128> silences;  // By node; 0: of SYNC.
  for (std::size_t i = 0; i < findings_.size(); ++i) {
    const Finding& finding = findings_[i];
    const bool is_sync = finding.kind == FindingKind::kGap && finding.node == 0;
    if (finding.kind == FindingKind::kHeartbeatLost || is_sync) silences[finding.node].push_back(i);
  }
  for (std::vector<std::size_t>& one : silences) {
    std::ranges::sort(one, {}, [&](std::size_t i) { return end_of(findings_[i]); });
  }
  const auto find = [&](const Finding& gap, std::uint8_t node) -> Finding* {
    const auto& list = silences[node];
    const auto place = std::ranges::lower_bound(list, gap.at, {}, [&](std::size_t i) { return end_of(findings_[i]); });
    return place == list.end() || findings_[*place].at > end_of(gap) ? nullptr : &findings_[*place];
  };
  std::vector<bool> absorbed(findings_.size());
  for (std::size_t i = 0; i < findings_.size(); ++i) {
    const Finding& gap = findings_[i];
    if (gap.kind != FindingKind::kGap || gap.node == 0) continue;
    Finding* const silence = find(gap, gap.node);
    absorbed[i] = silence != nullptr || find(gap, 0) != nullptr;
    if (silence == nullptr) continue;
    silence->code = 1;
    silence->at = std::max(silence->at, gap.at);
  }
  std::size_t number = 0;
  std::erase_if(findings_, [&](const Finding&) { return absorbed[number++]; });
}

void Story::word(Finding& finding) const {
  const std::string until =
      finding.until ? fmt::format("{:.6f} s", to_s(*finding.until)) : std::string{"the end of the log"};
  const double lasted_s = to_s(finding.until.value_or(now_) - finding.at);
  switch (finding.kind) {
    case FindingKind::kHeartbeatLost:
    case FindingKind::kGap:
      finding.text += fmt::format(" lost: none from here to {}, {:.6g} s; one every {:.6g} ms before", until, lasted_s,
                                  finding.before * 1e3);
      if (finding.code == 1) finding.text += "; nothing else of it either";
      return;
    case FindingKind::kSdo:
      finding.text += fmt::format(": {} transfers to {}", finding.count, until);
      return;
    case FindingKind::kSetPoint:
      finding.text += finding.count == 1 && finding.before == finding.after
                          ? fmt::format(" {:.6g}", finding.after)
                          : fmt::format(" {:.6g} -> {:.6g}", finding.before, finding.after);
      if (finding.count > 1) finding.text += fmt::format(", {} changes to {}", finding.count, until);
      return;
    case FindingKind::kInvalid:
      finding.text += fmt::format(", to {}", until);
      return;
    default:
      if (finding.count > 1) finding.text += fmt::format("; {} of them to {}", finding.count, until);
      return;
  }
}

}  // namespace meltbench::decode
