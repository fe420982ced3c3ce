#include "bench/decode/bus_view.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "protocols/canopen/eds.hpp"
#include "protocols/canopen/emcy.hpp"
#include "protocols/config/toml.hpp"

namespace meltbench::decode {
namespace {

constexpr std::uint32_t kNodeMask = 0x7F;
constexpr std::uint32_t kFunctionMask = 0x780;
constexpr std::uint16_t kLastCommunicationObject = 0x1FFF;

double to_number(const canopen::OdEntry& entry, std::span<const std::uint8_t> bytes) {
  switch (entry.info().type) {
    case canopen::DataType::kReal32:
      return bytes.size() >= 4 ? static_cast<double>(canopen::load<float>(bytes)) : 0.0;
    case canopen::DataType::kReal64:
      return bytes.size() >= 8 ? canopen::load<double>(bytes) : 0.0;
    default:
      break;
  }
  std::uint64_t raw = 0;
  for (std::size_t i = 0; i < bytes.size() && i < 8; ++i) raw |= std::uint64_t{bytes[i]} << (8 * i);
  const std::size_t bits = 8 * std::min<std::size_t>(bytes.size(), 8);
  const bool is_negative = canopen::is_signed(entry.info().type) && bits > 0 && ((raw >> (bits - 1)) & 1U) != 0;
  if (is_negative && bits < 64) raw |= ~std::uint64_t{0} << bits;
  return is_negative ? static_cast<double>(static_cast<std::int64_t>(raw)) : static_cast<double>(raw);
}

canopen::ObjectAddress sdo_address(const can::CanFrame& frame) {
  return {static_cast<std::uint16_t>(frame.bytes[1] | frame.bytes[2] << 8U), frame.bytes[3]};
}

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

BusView::BusView(const config::Rig& rig) : controller_id_{rig.controller_node_id} {
  for (const config::RigBoard& board : rig.boards) {
    if (board.node_id == 0) continue;  // On a serial line.
    auto node = std::make_unique<Node>();
    node->name = board.name;
    node->id = board.node_id;
    const std::string text = config::read_text_file(board.eds, board.section.origin());
    node->dictionary = std::move(canopen::read_eds(text, board.eds.string(), board.node_id).dictionary);
    nodes_.push_back(std::move(node));
  }
  list_pdos();
}

void BusView::list_pdos() {
  pdos_.fill({});
  for (const auto& node : nodes_) {
    node->tpdos = canopen::read_pdos(node->dictionary, canopen::PdoDirection::kTransmit);
    node->rpdos = canopen::read_pdos(node->dictionary, canopen::PdoDirection::kReceive);
    for (canopen::Pdo& pdo : node->tpdos) {
      if (pdo.active && !pdo.extended) pdos_[pdo.id] = {node.get(), &pdo, canopen::PdoDirection::kTransmit};
    }
    for (canopen::Pdo& pdo : node->rpdos) {
      if (pdo.active && !pdo.extended) pdos_[pdo.id] = {node.get(), &pdo, canopen::PdoDirection::kReceive};
    }
  }
}

const BusView::Node* BusView::find_node(std::uint8_t id) const {
  for (const auto& node : nodes_) {
    if (node->id == id) return node.get();
  }
  return nullptr;
}

BusView::Node* BusView::find_node(std::uint8_t id) {
  return const_cast<Node*>(std::as_const(*this).find_node(id));
}

const BusView::PdoPlace* BusView::find_pdo(const can::CanFrame& frame) const {
  if (frame.extended || frame.kind != can::FrameKind::kData || frame.id > can::kMaxStandardId) return nullptr;
  const PdoPlace& place = pdos_[frame.id];
  return place.pdo == nullptr ? nullptr : &place;
}

void BusView::take(const can::CanFrame& frame) {
  const FrameMeaning meaning = meaning_of(frame);
  Node* node = meaning.node == 0 ? nullptr : find_node(meaning.node);
  if (node == nullptr || frame.length == 0) return;
  switch (meaning.service) {
    case Service::kSdoRequest:
      return note_download(*node, frame);
    case Service::kSdoResponse:
      if (frame.bytes[0] == 0x60) confirm_download(*node);
      node->asked.reset();
      return;
    case Service::kHeartbeat:
      if (frame.bytes[0] == 0) restore_defaults(*node);
      return;
    default:
      return;
  }
}

/// Only what changes PDOs is of interest, and that fits into expedited transfers.
void BusView::note_download(Node& node, const can::CanFrame& request) {
  node.asked.reset();
  const std::uint8_t command = request.bytes[0];
  const canopen::ObjectAddress address = sdo_address(request);
  constexpr std::uint8_t kExpeditedWithSize = 0x23;
  if (request.length != 8 || (command & 0xE3U) != kExpeditedWithSize || !canopen::is_pdo_object(address.index)) return;
  const std::size_t size = 4U - ((command >> 2U) & 3U);
  node.asked = Node::Download{address, {request.bytes.begin() + 4, request.bytes.begin() + 4 + size}};
}

void BusView::confirm_download(Node& node) {
  if (!node.asked) return;
  canopen::OdEntry* entry = node.dictionary.find(node.asked->address.index, node.asked->address.sub);
  if (entry == nullptr || entry->check_size(node.asked->value.size()) != canopen::AbortCode::kNone) return;
  entry->assign(node.asked->value);
  const bool is_finished = node.asked->address.sub <= 1;  // A mapping is closed by sub 0, a PDO switched by sub 1.
  if (is_finished) list_pdos();
}

void BusView::restore_defaults(Node& node) {
  for (auto& [address, entry] : node.dictionary.entries()) {
    if (address.index <= kLastCommunicationObject) entry.restore_default();
  }
  list_pdos();
}

FrameMeaning BusView::meaning_of(const can::CanFrame& frame) const {
  if (frame.extended || frame.kind == can::FrameKind::kError) return {};
  const auto node = static_cast<std::uint8_t>(frame.id & kNodeMask);
  if (frame.id == canopen::cob_id::kNmt) return {Service::kNmt, 0, 0};
  if (frame.id == canopen::cob_id::kSync) return {Service::kSync, 0, 0};
  if (const PdoPlace* place = find_pdo(frame)) {
    const bool is_sent = place->direction == canopen::PdoDirection::kTransmit;
    const canopen::Pdo& pdo = *place->pdo;
    const bool is_cyclic = is_sent && ((pdo.is_synchronous() && pdo.type > 0) || pdo.event_time > Nanos{0});
    return {is_sent ? Service::kTpdo : Service::kRpdo, place->node->id, static_cast<std::uint8_t>(pdo.number),
            is_cyclic};
  }
  if ((frame.id & kFunctionMask) == canopen::cob_id::kSync) return {Service::kEmcy, node, 0};
  const Service service = to_service(frame.id);
  if (service == Service::kOther || node == 0) return {};
  return {service, node, 0};
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
  canopen::ObjectDictionary& objects = place->node->dictionary;
  const auto index = static_cast<std::uint16_t>(canopen::pdo_mapping_index(place->direction) + place->pdo->number - 1);
  const std::int64_t count = objects.integer_or(index, 0, 0);
  std::size_t first = 0;
  for (std::uint8_t sub = 1; sub <= count; ++sub) {
    const auto mapped = static_cast<std::uint32_t>(objects.integer_or(index, sub, 0));
    const std::size_t size = (mapped & 0xFFU) / 8;
    if (first + size > frame.data().size()) break;
    const canopen::ObjectAddress address{static_cast<std::uint16_t>(mapped >> 16U),
                                         static_cast<std::uint8_t>(mapped >> 8U)};
    if (const canopen::OdEntry* entry = objects.find(address.index, address.sub)) {
      values_.push_back({address, entry->info().name, to_number(*entry, frame.data().subspan(first, size))});
    }
    first += size;
  }
  return values_;
}

std::string BusView::name_of(std::uint8_t node) const {
  if (const Node* known = find_node(node)) return known->name;
  return node == controller_id_ ? "controller" : fmt::format("node {}", node);
}

std::string BusView::describe(const can::CanFrame& frame) {
  if (frame.kind == can::FrameKind::kError) return fmt::format("error frame, class {:03X}h", frame.id);
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
  const canopen::ObjectAddress address = sdo_address(frame);
  const unsigned command = frame.bytes[0] >> 5U;
  if (frame.bytes[0] == 0x80) {
    const auto code = static_cast<canopen::AbortCode>(canopen::load<std::uint32_t>(frame.data(), 4));
    return fmt::format("{} SDO abort {}: {}", who, text(address), text(code));
  }
  const bool is_request = meaning.service == Service::kSdoRequest;
  if (is_request && command == 1) return fmt::format("SDO write {} {}", who, text(address));
  if (is_request && command == 2) return fmt::format("SDO read {} {}", who, text(address));
  if (!is_request && command == 3) return fmt::format("{} SDO written {}", who, text(address));
  if (!is_request && command == 2) return fmt::format("{} SDO value {}", who, text(address));
  return fmt::format("{}{} SDO segment", is_request ? "to " : "", who);
}

}  // namespace meltbench::decode
