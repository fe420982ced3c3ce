#include "bench/decode/bus_view.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "protocols/canopen/emcy.hpp"
#include "protocols/canopen/sdo.hpp"

namespace meltbench::decode {
namespace {

constexpr std::uint32_t kNodeMask = 0x7F;
constexpr std::uint32_t kFunctionMask = 0x780;

Service to_service(std::uint32_t id) {
  switch (id & kFunctionMask) {
    case 0x580:
      return Service::kSdoResponse;
    case 0x600:
      return Service::kSdoRequest;
    case 0x700:
      return Service::kHeartbeat;
    default:
      return Service::kOther;
  }
}

std::string describe_nmt(const can::CanFrame& frame, const std::string& whom) {
  switch (static_cast<canopen::NmtCommand>(frame.bytes[0])) {
    case canopen::NmtCommand::kStart:
      return fmt::format("NMT: start {}", whom);
    case canopen::NmtCommand::kStop:
      return fmt::format("NMT: stop {}", whom);
    case canopen::NmtCommand::kEnterPreOperational:
      return fmt::format("NMT: {} to pre-operational", whom);
    case canopen::NmtCommand::kResetNode:
      return fmt::format("NMT: reset {}", whom);
    case canopen::NmtCommand::kResetCommunication:
      return fmt::format("NMT: reset communication of {}", whom);
  }
  return fmt::format("NMT: unknown command {:02X}h to {}", frame.bytes[0], whom);
}

}  // namespace

BusView::BusView(const config::Rig& rig, const Dbc* dbc)
    : dbc_{dbc}, has_rig_{!rig.boards.empty()}, controller_id_{rig.controller_node_id} {
  for (const config::RigBoard& board : rig.boards) {
    if (!board.is_on_line()) boards_.emplace_back(board);
  }
  list_pdos();
}

void BusView::list_pdos() {
  pdos_.fill({});
  for (const BoardObjects& board : boards_) {
    for (const FollowedPdo& followed : board.pdos()) {
      const canopen::Pdo& pdo = followed.pdo;
      if (pdo.active && !pdo.extended && pdo.id <= can::kMaxStandardId) pdos_[pdo.id] = {&board, &followed};
    }
  }
}

const BoardObjects* BusView::find_board(std::uint8_t node) const {
  const auto found = std::ranges::find(boards_, node, &BoardObjects::node_id);
  return found == boards_.end() ? nullptr : &*found;
}

const BusView::PdoPlace* BusView::find_pdo(const can::CanFrame& frame) const {
  if (frame.extended || frame.kind != can::FrameKind::kData || frame.id > can::kMaxStandardId) return nullptr;
  const PdoPlace& place = pdos_[frame.id];
  return place.followed == nullptr ? nullptr : &place;
}

void BusView::take(const can::CanFrame& frame) {
  bool has_changed = false;
  for (BoardObjects& board : boards_) has_changed |= board.follow(frame).pdos;
  if (has_changed) list_pdos();
}

FrameMeaning BusView::meaning_of(const can::CanFrame& frame) const {
  if (!has_rig_ || frame.extended || frame.kind == can::FrameKind::kError) return {};
  const auto node = static_cast<std::uint8_t>(frame.id & kNodeMask);
  if (frame.id == canopen::cob_id::kNmt) return {Service::kNmt, 0, 0};
  if (frame.id == canopen::cob_id::kSync) return {Service::kSync, 0, 0};
  if (const PdoPlace* place = find_pdo(frame)) {
    const bool is_sent = place->followed->direction == canopen::PdoDirection::kTransmit;
    const canopen::Pdo& pdo = place->followed->pdo;
    const bool is_cyclic = is_sent && ((pdo.is_synchronous() && pdo.type > 0) || pdo.event_time > Nanos{0});
    return {is_sent ? Service::kTpdo : Service::kRpdo, place->board->node_id(), static_cast<std::uint8_t>(pdo.number),
            is_cyclic};
  }
  if ((frame.id & kFunctionMask) == canopen::cob_id::kSync) return {Service::kEmcy, node, 0};
  const Service service = to_service(frame.id);
  if (service == Service::kOther || node == 0) return {};
  return {service, node, 0};
}

const DbcMessage* BusView::find_message(const can::CanFrame& frame) const {
  if (dbc_ == nullptr) return nullptr;
  const FrameMeaning meaning = meaning_of(frame);
  const bool is_known = meaning.node == 0 || meaning.node == controller_id_ || find_board(meaning.node) != nullptr;
  return meaning.service != Service::kOther && is_known ? nullptr : dbc_->find(frame);
}

bool BusView::is_from_controller(const can::CanFrame& frame) const {
  const FrameMeaning meaning = meaning_of(frame);
  switch (meaning.service) {
    case Service::kNmt:
    case Service::kSync:
    case Service::kRpdo:
    case Service::kSdoRequest:
      return true;
    case Service::kHeartbeat:
    case Service::kEmcy:
      return meaning.node == controller_id_;
    default:
      return false;
  }
}

std::span<const DecodedValue> BusView::values_of(const can::CanFrame& frame) {
  values_.clear();
  const PdoPlace* place = find_pdo(frame);
  if (place == nullptr) return values_;
  for (const MappedObject& object : place->followed->objects) {
    if (object.first + object.size > frame.data().size()) break;
    values_.push_back({object.entry->address(), object.entry->info().name,
                       to_number(*object.entry, frame.data().subspan(object.first, object.size)),
                       object.entry->info().type});
  }
  return values_;
}

std::string BusView::name_of(std::uint8_t node) const {
  if (const BoardObjects* board = find_board(node)) return board->name();
  return node == controller_id_ ? "controller" : fmt::format("node {}", node);
}

std::string BusView::describe(const can::CanFrame& frame) {
  if (frame.kind == can::FrameKind::kError) return fmt::format("error frame, class {:03X}h", frame.id);
  if (const DbcMessage* message = find_message(frame)) return describe_message(*message, frame.data());
  const FrameMeaning meaning = meaning_of(frame);
  const std::string who = name_of(meaning.node);
  switch (meaning.service) {
    case Service::kNmt:
      return describe_nmt(frame, frame.bytes[1] == 0 ? "all" : name_of(frame.bytes[1]));
    case Service::kSync:
      return "SYNC";
    case Service::kEmcy:
      if (const auto emcy = canopen::parse_emcy(frame)) {
        return fmt::format("{} EMCY {:04X}h: {}", who, emcy->emcy.code, canopen::emcy_text(emcy->emcy.code));
      }
      break;
    case Service::kTpdo:
      return fmt::format("{} TPDO{}: {}", who, meaning.number, describe_values(frame));
    case Service::kRpdo:
      return fmt::format("to {} RPDO{}: {}", who, meaning.number, describe_values(frame));
    case Service::kSdoRequest:
    case Service::kSdoResponse:
      return describe_sdo(meaning, frame);
    case Service::kHeartbeat:
      return frame.length == 1 && frame.bytes[0] == 0
                 ? fmt::format("{} boot-up", who)
                 : fmt::format("{} heartbeat: {}", who, text(static_cast<canopen::NmtState>(frame.bytes[0] & 0x7FU)));
    case Service::kOther:
      break;
  }
  return fmt::format("identifier {:X}h, {} bytes", frame.id, frame.data().size());
}

std::string BusView::describe_values(const can::CanFrame& frame) {
  std::string line;
  for (const DecodedValue& value : values_of(frame)) {
    line += fmt::format("{}{} {:.6g}", line.empty() ? "" : ", ", value.name, value.value);
  }
  return line;
}

std::string BusView::describe_sdo(const FrameMeaning& meaning, const can::CanFrame& frame) const {
  const std::string who = name_of(meaning.node);
  if (frame.length != 8) return fmt::format("{} SDO of {} bytes", who, frame.length);
  const canopen::ObjectAddress address = canopen::sdo_address(frame.bytes);
  const unsigned command = frame.bytes[0] >> 5U;
  if (frame.bytes[0] == 0x80) {
    const auto code = static_cast<canopen::AbortCode>(canopen::load<std::uint32_t>(frame.data(), 4));
    return fmt::format("{} SDO abort {}: {}", who, text(address), text(code));
  }
  const bool is_request = meaning.service == Service::kSdoRequest;
  const auto value = [&] { return describe_expedited(meaning.node, frame); };
  if (is_request && command == 1) return fmt::format("SDO write {} {}{}", who, text(address), value());
  if (is_request && command == 2) return fmt::format("SDO read {} {}", who, text(address));
  if (!is_request && command == 3) return fmt::format("{} SDO written {}", who, text(address));
  if (!is_request && command == 2) return fmt::format("{} SDO value {}{}", who, text(address), value());
  return fmt::format("{}{} SDO segment", is_request ? "to " : "", who);
}

/// ", NAME = VALUE" where the frame has the value itself.
std::string BusView::describe_expedited(std::uint8_t node, const can::CanFrame& frame) const {
  if ((frame.bytes[0] & 2U) == 0) return {};
  const auto [index, sub] = canopen::sdo_address(frame.bytes);
  const BoardObjects* board = find_board(node);
  const canopen::OdEntry* entry = board == nullptr ? nullptr : board->dictionary().find(index, sub);
  if (entry == nullptr) return {};
  const std::size_t size =
      (frame.bytes[0] & 1U) != 0 ? 4U - (frame.bytes[0] >> 2U & 3U) : std::min<std::size_t>(entry->capacity(), 4);
  return fmt::format(", {} = {:.10g}", entry->info().name, to_number(*entry, frame.data().subspan(4, size)));
}

}  // namespace meltbench::decode
