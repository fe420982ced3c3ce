#include "bench/record/wire_signals.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <limits>
#include <stdexcept>

#include "protocols/canopen/eds.hpp"

namespace meltbench::record {
namespace {

using canopen::ObjectAddress;
using canopen::PdoDirection;

constexpr std::uint8_t kExpeditedDownload = 0x22;  // Command specifier 1, expedited.
constexpr std::uint8_t kExpeditedMask = 0xE2;
constexpr std::uint8_t kSizeGiven = 0x01;
constexpr std::uint8_t kDownloadDone = 0x60;
constexpr std::uint16_t kFirstOfDevice = 0x2000;  // Below are the objects of communication.

/// "wire.feeder.2001", "wire.heater.7130_2".
std::string make_name(std::string_view board, const canopen::EntryInfo& info) {
  const std::string index = fmt::format("wire.{}.{:04X}", board, info.address.index);
  return info.object_code == canopen::ObjectCode::kVar ? index : fmt::format("{}_{}", index, info.address.sub);
}

double to_number(const canopen::OdEntry& entry) {
  switch (entry.info().type) {
    case canopen::DataType::kReal32:
      return static_cast<double>(entry.get<float>());
    case canopen::DataType::kReal64:
      return entry.get<double>();
    default:
      return static_cast<double>(entry.to_int64());
  }
}

bool is_number(const canopen::OdEntry& entry) {
  // Only numbers have a smallest size.
  return entry.check_size(0) != canopen::AbortCode::kNone;
}

ObjectAddress address_in(const can::CanFrame& frame) {
  return {static_cast<std::uint16_t>(frame.bytes[1] | frame.bytes[2] << 8U), frame.bytes[3]};
}

PdoDirection direction_of(std::uint16_t pdo_index) {
  return pdo_index < canopen::pdo_parameter_index(PdoDirection::kTransmit) ? PdoDirection::kReceive
                                                                           : PdoDirection::kTransmit;
}

canopen::ObjectDictionary read_dictionary(const config::RigBoard& board) {
  std::ifstream file{board.eds, std::ios::binary};
  const std::string text{std::istreambuf_iterator<char>{file}, {}};
  if (!file) board.section.fail("eds", "cannot be read", board.eds.string());
  try {
    return canopen::read_eds(text, board.eds.string(), board.node_id).dictionary;
  } catch (const canopen::EdsError& error) {
    board.section.fail("eds", fmt::format("must be a sound EDS: {}", error.what()), error.hint());
  }
}

}  // namespace

WireSignals::WireSignals(std::span<const config::RigBoard> boards, std::span<const std::string> wanted) {
  for (const config::RigBoard& board : boards) {
    if (!board.is_on_line()) add_node(board, wanted);
  }
}

void WireSignals::add_node(const config::RigBoard& board, std::span<const std::string> wanted) {
  Node& node = nodes_.emplace_back(Node{board.name, board.node_id, read_dictionary(board), {}, {}});
  try {
    for (const PdoDirection direction : {PdoDirection::kReceive, PdoDirection::kTransmit}) {
      for (canopen::Pdo& pdo : canopen::read_pdos(node.dictionary, direction)) {
        node.pdos.push_back({direction, std::move(pdo), {}});
      }
    }
  } catch (const std::invalid_argument& error) {
    board.section.fail("eds", fmt::format("must have sound PDOs: {}", error.what()));
  }
  std::vector<ObjectAddress> mapped;
  for (const auto& [address, entry] : node.dictionary.entries()) {
    const bool is_mapping =
        (address.index >= 0x1600 && address.index <= 0x17FF) || (address.index >= 0x1A00 && address.index <= 0x1BFF);
    if (!is_mapping || address.sub == 0) continue;
    const auto item = static_cast<std::uint32_t>(entry.to_int64());
    mapped.push_back({static_cast<std::uint16_t>(item >> 16U), static_cast<std::uint8_t>(item >> 8U)});
  }
  for (const auto& [address, entry] : node.dictionary.entries()) {
    if (address.index < kFirstOfDevice || !is_number(entry)) continue;
    const bool is_mapped = std::ranges::find(mapped, address) != mapped.end();
    const bool is_wanted = std::ranges::find(wanted, make_name(node.name, entry.info())) != wanted.end();
    if (is_mapped || is_wanted) add_column(node, entry);
  }
  for (FollowedPdo& followed : node.pdos) note_columns(node, followed);
}

void WireSignals::add_column(const Node& node, const canopen::OdEntry& entry) {
  columns_.push_back({&entry, false});
  signals_.push_back({make_name(node.name, entry.info()), SignalKind::kValue});
}

void WireSignals::note_columns(Node& node, FollowedPdo& followed) {
  followed.columns.clear();
  const auto mapping =
      static_cast<std::uint16_t>(canopen::pdo_mapping_index(followed.direction) + followed.pdo.number - 1);
  const auto count = static_cast<std::uint8_t>(std::min<std::int64_t>(node.dictionary.integer_or(mapping, 0, 0), 64));
  for (std::uint8_t sub = 1; sub <= count; ++sub) {
    const auto item = static_cast<std::uint32_t>(node.dictionary.integer_or(mapping, sub, 0));
    const canopen::OdEntry* entry =
        node.dictionary.find(static_cast<std::uint16_t>(item >> 16U), static_cast<std::uint8_t>(item >> 8U));
    for (std::size_t column = 0; entry != nullptr && column < columns_.size(); ++column) {
      if (columns_[column].entry == entry) followed.columns.push_back(column);
    }
  }
}

void WireSignals::on_frame(const can::CanFrame& frame) {
  if (frame.extended || frame.kind != can::FrameKind::kData) return;
  for (Node& node : nodes_) {
    if (frame.id == 0x600U + node.id) return take_sdo_request(node, frame);
    if (frame.id == 0x580U + node.id) return take_sdo_answer(node, frame);
    if (frame.id == 0x700U + node.id && frame.length == 1 && frame.bytes[0] == 0) return reset_mapping(node);
    for (FollowedPdo& followed : node.pdos) {
      const canopen::Pdo& pdo = followed.pdo;
      if (!pdo.active || pdo.id != frame.id || pdo.extended || frame.length < pdo.mapping.length()) continue;
      pdo.mapping.scatter(frame.bytes.data());
      for (const std::size_t column : followed.columns) columns_[column].seen = true;
    }
  }
}

void WireSignals::take_sdo_request(Node& node, const can::CanFrame& frame) const {
  node.asked.reset();
  if (frame.length != 8 || (frame.bytes[0] & kExpeditedMask) != kExpeditedDownload) return;
  const ObjectAddress address = address_in(frame);
  const canopen::OdEntry* entry = node.dictionary.find(address.index, address.sub);
  if (entry == nullptr) return;
  const std::size_t size = (frame.bytes[0] & kSizeGiven) != 0 ? 4U - (frame.bytes[0] >> 2U & 3U)
                                                              : std::min<std::size_t>(entry->capacity(), 4);
  const auto* first = frame.bytes.data() + 4;
  node.asked = Write{address, {first, first + size}};
}

void WireSignals::take_sdo_answer(Node& node, const can::CanFrame& frame) {
  const std::optional<Write> write = std::exchange(node.asked, std::nullopt);
  if (!write || frame.length != 8 || frame.bytes[0] != kDownloadDone || address_in(frame) != write->address) return;
  canopen::OdEntry* entry = node.dictionary.find(write->address.index, write->address.sub);
  if (entry->check_size(write->value.size()) != canopen::AbortCode::kNone) return;
  entry->assign(write->value);
  for (Column& column : columns_) {
    if (column.entry == entry) column.seen = true;
  }
  if (canopen::is_pdo_object(write->address.index)) read_mapping(node, write->address.index);
}

void WireSignals::read_mapping(Node& node, std::uint16_t index) {
  const unsigned number = (index & (canopen::kMaxPdoCount - 1U)) + 1U;
  for (FollowedPdo& followed : node.pdos) {
    if (followed.direction != direction_of(index) || followed.pdo.number != number) continue;
    static_cast<void>(canopen::read_pdo(node.dictionary, followed.direction, followed.pdo));
    note_columns(node, followed);
  }
}

void WireSignals::reset_mapping(Node& node) {
  node.asked.reset();
  for (auto& [address, entry] : node.dictionary.entries()) {
    if (canopen::is_pdo_object(address.index)) entry.restore_default();
  }
  for (FollowedPdo& followed : node.pdos) {
    static_cast<void>(canopen::read_pdo(node.dictionary, followed.direction, followed.pdo));
    note_columns(node, followed);
  }
}

void WireSignals::read(std::span<double> values) const {
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    values[i] = columns_[i].seen ? to_number(*columns_[i].entry) : std::numeric_limits<double>::quiet_NaN();
  }
}

}  // namespace meltbench::record
