#include "bench/decode/board_objects.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "protocols/canopen/eds.hpp"
#include "protocols/canopen/sdo.hpp"
#include "protocols/config/toml.hpp"

namespace meltbench::decode {
namespace {

using canopen::PdoDirection;

constexpr std::uint8_t kExpeditedDownload = 0x22;  // Command specifier 1, expedited.
constexpr std::uint8_t kExpeditedMask = 0xE2;
constexpr std::uint8_t kSizeGiven = 0x01;
constexpr std::uint8_t kDownloadDone = 0x60;

PdoDirection direction_of(std::uint16_t pdo_index) {
  return pdo_index < canopen::pdo_parameter_index(PdoDirection::kTransmit) ? PdoDirection::kReceive
                                                                           : PdoDirection::kTransmit;
}

canopen::ObjectDictionary read_dictionary(const config::RigBoard& board) {
  const std::string text = config::read_text_file(board.eds, board.section.origin());
  try {
    return std::move(canopen::read_eds(text, board.eds.string(), board.node_id).dictionary);
  } catch (const canopen::EdsError& error) {
    board.section.fail("eds", fmt::format("must be a sound EDS: {}", error.what()), error.hint());
  }
}

}  // namespace

double to_number(const canopen::OdEntry& entry, std::span<const std::uint8_t> bytes) {
  const canopen::DataType type = entry.info().type;
  if (type == canopen::DataType::kReal32)
    return bytes.size() >= 4 ? static_cast<double>(canopen::load<float>(bytes)) : 0;
  if (type == canopen::DataType::kReal64) return bytes.size() >= 8 ? canopen::load<double>(bytes) : 0;
  if (canopen::size_of(type) == 0) return 0;
  std::uint64_t raw = 0;
  for (std::size_t i = 0; i < bytes.size() && i < 8; ++i) raw |= std::uint64_t{bytes[i]} << (8 * i);
  const std::size_t bits = 8 * std::min<std::size_t>(bytes.size(), 8);
  const bool is_negative = canopen::is_signed(type) && bits > 0 && ((raw >> (bits - 1)) & 1U) != 0;
  if (is_negative && bits < 64) raw |= ~std::uint64_t{0} << bits;
  return is_negative ? static_cast<double>(static_cast<std::int64_t>(raw)) : static_cast<double>(raw);
}

BoardObjects::BoardObjects(const config::RigBoard& board)
    : name_{board.name}, node_id_{board.node_id}, dictionary_{read_dictionary(board)} {
  try {
    for (const PdoDirection direction : {PdoDirection::kReceive, PdoDirection::kTransmit}) {
      for (canopen::Pdo& pdo : canopen::read_pdos(dictionary_, direction)) {
        pdos_.push_back({direction, std::move(pdo), {}});
      }
    }
  } catch (const std::invalid_argument& error) {
    board.section.fail("eds", fmt::format("must have sound PDOs: {}", error.what()));
  }
  for (FollowedPdo& followed : pdos_) list_objects(followed);
}

BoardObjects::Change BoardObjects::follow(const can::CanFrame& frame) {
  if (frame.extended || frame.kind != can::FrameKind::kData) return {};
  if (frame.id == canopen::cob_id::sdo_request(node_id_)) {
    take_request(frame);
    return {};
  }
  if (frame.id == canopen::cob_id::sdo_response(node_id_)) return take_answer(frame);
  const bool is_boot = frame.id == canopen::cob_id::heartbeat(node_id_) && frame.length == 1 && frame.bytes[0] == 0;
  return is_boot ? restore_pdos() : Change{};
}

void BoardObjects::take_request(const can::CanFrame& frame) {
  asked_.reset();
  if (frame.length != 8 || (frame.bytes[0] & kExpeditedMask) != kExpeditedDownload) return;
  const canopen::ObjectAddress address = canopen::sdo_address(frame.bytes);
  const canopen::OdEntry* entry = dictionary_.find(address.index, address.sub);
  if (entry == nullptr) return;
  const std::size_t size = (frame.bytes[0] & kSizeGiven) != 0 ? 4U - (frame.bytes[0] >> 2U & 3U)
                                                              : std::min<std::size_t>(entry->capacity(), 4);
  const auto* first = frame.bytes.data() + 4;
  asked_ = Write{address, {first, first + size}};
}

BoardObjects::Change BoardObjects::take_answer(const can::CanFrame& frame) {
  const std::optional<Write> write = std::exchange(asked_, std::nullopt);
  if (!write || frame.length != 8 || frame.bytes[0] != kDownloadDone) return {};
  if (canopen::sdo_address(frame.bytes) != write->address) return {};
  const auto [index, sub] = write->address;
  canopen::OdEntry* entry = dictionary_.find(index, sub);
  if (entry->check_size(write->value.size()) != canopen::AbortCode::kNone) return {};
  entry->assign(write->value);
  if (!canopen::is_pdo_object(index)) return {entry, false};
  const unsigned number = (index & (canopen::kMaxPdoCount - 1U)) + 1U;
  for (FollowedPdo& followed : pdos_) {
    if (followed.direction == direction_of(index) && followed.pdo.number == number) read_again(followed);
  }
  return {entry, true};
}

BoardObjects::Change BoardObjects::restore_pdos() {
  asked_.reset();
  for (auto& [address, entry] : dictionary_.entries()) {
    if (canopen::is_pdo_object(address.index)) entry.restore_default();
  }
  for (FollowedPdo& followed : pdos_) read_again(followed);
  return {nullptr, true};
}

void BoardObjects::read_again(FollowedPdo& followed) {
  static_cast<void>(canopen::read_pdo(dictionary_, followed.direction, followed.pdo));
  list_objects(followed);
}

void BoardObjects::list_objects(FollowedPdo& followed) {
  followed.objects.clear();
  const auto mapping =
      static_cast<std::uint16_t>(canopen::pdo_mapping_index(followed.direction) + followed.pdo.number - 1);
  const std::int64_t count = std::min<std::int64_t>(dictionary_.integer_or(mapping, 0, 0), 64);
  std::size_t first = 0;
  for (std::uint8_t sub = 1; sub <= count; ++sub) {
    const auto item = static_cast<std::uint32_t>(dictionary_.integer_or(mapping, sub, 0));
    const std::size_t size = (item & 0xFFU) / 8;
    const canopen::OdEntry* entry =
        dictionary_.find(static_cast<std::uint16_t>(item >> 16U), static_cast<std::uint8_t>(item >> 8U));
    if (entry != nullptr) followed.objects.push_back({entry, first, size});
    first += size;
  }
}

}  // namespace meltbench::decode
