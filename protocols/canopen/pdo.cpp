#include "protocols/canopen/pdo.hpp"

#include <algorithm>
#include <stdexcept>

#include <fmt/format.h>

namespace meltbench::canopen {
namespace {

constexpr std::uint8_t kCobIdSub = 1;
constexpr std::uint8_t kTypeSub = 2;
constexpr std::uint8_t kInhibitSub = 3;
constexpr std::uint8_t kEventSub = 5;
constexpr std::uint8_t kSyncStartSub = 6;
constexpr std::uint8_t kMaxItems = 8;
constexpr std::uint32_t kCobIdBits = 0x1FFF'FFFF;

std::uint16_t parameter_index(PdoDirection direction, unsigned number) {
  return static_cast<std::uint16_t>(pdo_parameter_index(direction) + number - 1);
}

std::uint16_t mapping_index(PdoDirection direction, unsigned number) {
  return static_cast<std::uint16_t>(pdo_mapping_index(direction) + number - 1);
}

std::uint32_t read_u32(const ObjectDictionary& dictionary, std::uint16_t index, std::uint8_t sub,
                       std::uint32_t otherwise) {
  return static_cast<std::uint32_t>(dictionary.integer_or(index, sub, otherwise));
}

/// What an index in the PDO range is about.
struct PdoObject {
  PdoDirection direction;
  unsigned number;
  bool is_mapping;
};

PdoObject classify(std::uint16_t index) {
  return {index < 0x1800 ? PdoDirection::kReceive : PdoDirection::kTransmit, 1U + (index & 0x1FFU),
          (index & 0x0200U) != 0};
}

AbortCode check_mapped_object(const ObjectDictionary& dictionary, PdoDirection direction, std::uint32_t map_entry,
                              std::uint8_t& size) {
  const auto index = static_cast<std::uint16_t>(map_entry >> 16);
  const auto sub = static_cast<std::uint8_t>(map_entry >> 8);
  const auto bits = static_cast<std::uint8_t>(map_entry);
  std::size_t object_size = 0;
  if (index >= 1 && index <= 7) {
    if (direction != PdoDirection::kReceive || !dictionary.is_dummy_allowed(index)) return AbortCode::kNotMappable;
    object_size = size_of(static_cast<DataType>(index));
  } else {
    const OdEntry* const entry = dictionary.find(index, sub);
    if (entry == nullptr) return dictionary.has_index(index) ? AbortCode::kNoSubIndex : AbortCode::kNoObject;
    const EntryInfo& info = entry->info();
    const bool right_direction = direction == PdoDirection::kReceive
                                     ? is_writable(info.access) && info.access != AccessType::kReadWriteRead
                                     : is_readable(info.access) && info.access != AccessType::kReadWriteWrite;
    if (!info.mappable || !right_direction) return AbortCode::kNotMappable;
    object_size = size_of(info.type);
  }
  if (object_size == 0 || bits != 8 * object_size) return AbortCode::kNotMappable;
  size = static_cast<std::uint8_t>(object_size);
  return AbortCode::kNone;
}

AbortCode read_mapping(ObjectDictionary& dictionary, PdoDirection direction, unsigned number, std::uint8_t count,
                       PdoMapping& mapping) {
  const std::uint16_t index = mapping_index(direction, number);
  mapping = {};
  if (count > kMaxItems) return AbortCode::kPdoLength;
  for (std::uint8_t sub = 1; sub <= count; ++sub) {
    const OdEntry* const entry = dictionary.find(index, sub);
    if (entry == nullptr) return AbortCode::kTooHigh;
    const AbortCode code = mapping.append(dictionary, direction, static_cast<std::uint32_t>(entry->to_int64()));
    if (code != AbortCode::kNone) return code;
  }
  return AbortCode::kNone;
}

bool is_valid_cob_id(std::uint32_t value) {
  if ((value & kCobIdExtended) != 0) return true;
  const std::uint32_t id = value & kCobIdBits;
  return id <= can::kMaxStandardId && !cob_id::is_restricted(id);
}

bool is_valid_type(std::uint8_t type) {
  return type <= kLastSyncCyclic || type == kEventManufacturer || type == kEventProfile;
}

AbortCode check_mapping_write(ObjectDictionary& dictionary, const PdoObject& object, ObjectAddress address, bool is_off,
                              std::uint32_t value) {
  if (!is_off) return AbortCode::kDeviceState;
  if (address.sub == 0) {
    PdoMapping mapping;
    return read_mapping(dictionary, object.direction, object.number, static_cast<std::uint8_t>(value), mapping);
  }
  const bool is_open = read_u32(dictionary, address.index, 0, 0) != 0;
  if (is_open) return AbortCode::kDeviceState;
  std::uint8_t size = 0;
  return value == 0 ? AbortCode::kNone : check_mapped_object(dictionary, object.direction, value, size);
}

AbortCode check_parameter_write(std::uint8_t sub, bool is_off, std::uint32_t old_value, std::uint32_t value) {
  switch (sub) {
    case kCobIdSub: {
      if ((value & kPdoInvalid) != 0) return AbortCode::kNone;
      if (!is_off && ((value ^ old_value) & (kCobIdBits | kCobIdExtended)) != 0) return AbortCode::kDeviceState;
      return is_valid_cob_id(value) ? AbortCode::kNone : AbortCode::kInvalidValue;
    }
    case kTypeSub:
      return is_valid_type(static_cast<std::uint8_t>(value)) ? AbortCode::kNone : AbortCode::kInvalidValue;
    case kInhibitSub:
    case kSyncStartSub:
      return is_off || value == old_value ? AbortCode::kNone : AbortCode::kDeviceState;
    default:
      return AbortCode::kNone;
  }
}

}  // namespace

AbortCode PdoMapping::append(ObjectDictionary& dictionary, PdoDirection direction, std::uint32_t map_entry) {
  Item item;
  const AbortCode code = check_mapped_object(dictionary, direction, map_entry, item.size);
  if (code != AbortCode::kNone) return code;
  if (count_ == items_.size() || length_ + item.size > static_cast<int>(can::kMaxClassicLength)) {
    return AbortCode::kPdoLength;
  }
  OdEntry* const entry =
      dictionary.find(static_cast<std::uint16_t>(map_entry >> 16), static_cast<std::uint8_t>(map_entry >> 8));
  const bool is_gap = map_entry >> 16 <= 7;
  item.value = is_gap ? nullptr : entry->number_bytes().data();
  items_[count_++] = item;
  length_ = static_cast<std::uint8_t>(length_ + item.size);
  return AbortCode::kNone;
}

void PdoMapping::gather(std::uint8_t* bytes) const {
  for (std::uint8_t i = 0; i < count_; ++i) {
    std::memcpy(bytes, items_[i].value, items_[i].size);
    bytes += items_[i].size;
  }
}

void PdoMapping::scatter(const std::uint8_t* bytes) const {
  for (std::uint8_t i = 0; i < count_; ++i) {
    if (items_[i].value != nullptr) std::memcpy(items_[i].value, bytes, items_[i].size);
    bytes += items_[i].size;
  }
}

AbortCode read_pdo(ObjectDictionary& dictionary, PdoDirection direction, Pdo& pdo) {
  const std::uint16_t index = parameter_index(direction, pdo.number);
  const std::uint32_t cob_id = read_u32(dictionary, index, kCobIdSub, kPdoInvalid);
  pdo.id = cob_id & kCobIdBits;
  pdo.extended = (cob_id & kCobIdExtended) != 0;
  pdo.remote_allowed = direction == PdoDirection::kTransmit && (cob_id & kPdoNoRemote) == 0;
  pdo.type = static_cast<std::uint8_t>(read_u32(dictionary, index, kTypeSub, kEventProfile));
  const bool transmits = direction == PdoDirection::kTransmit;
  pdo.inhibit_time = transmits ? 100us * dictionary.integer_or(index, kInhibitSub, 0) : Nanos{0};
  pdo.event_time = 1ms * dictionary.integer_or(index, kEventSub, 0);
  pdo.sync_start =
      transmits ? static_cast<std::uint8_t>(read_u32(dictionary, index, kSyncStartSub, 0)) : std::uint8_t{0};
  const auto count = static_cast<std::uint8_t>(read_u32(dictionary, mapping_index(direction, pdo.number), 0, 0));
  const bool is_valid = (cob_id & kPdoInvalid) == 0;
  AbortCode code = read_mapping(dictionary, direction, pdo.number, count, pdo.mapping);
  if (code == AbortCode::kNone && is_valid && (!is_valid_cob_id(cob_id) || !is_valid_type(pdo.type))) {
    code = AbortCode::kInvalidValue;
  }
  pdo.active = code == AbortCode::kNone && is_valid && pdo.mapping.length() > 0;
  return code;
}

std::vector<Pdo> read_pdos(ObjectDictionary& dictionary, PdoDirection direction) {
  std::vector<Pdo> pdos;
  for (unsigned number = 1; number <= kMaxPdoCount; ++number) {
    const std::uint16_t index = parameter_index(direction, number);
    if (!dictionary.has_index(index)) continue;
    Pdo pdo;
    pdo.number = number;
    if (const AbortCode code = read_pdo(dictionary, direction, pdo); code != AbortCode::kNone) {
      throw std::invalid_argument(
          fmt::format("PDO 0x{:04X} with mapping 0x{:04X}: {}", index, mapping_index(direction, number), text(code)));
    }
    pdos.push_back(pdo);
  }
  return pdos;
}

bool is_pdo_object(std::uint16_t index) {
  return index >= 0x1400 && index <= 0x1BFF;
}

AbortCode check_pdo_write(ObjectDictionary& dictionary, ObjectAddress address, std::span<const std::uint8_t> value) {
  const PdoObject object = classify(address.index);
  const std::uint16_t parameters = parameter_index(object.direction, object.number);
  const bool is_off = (read_u32(dictionary, parameters, kCobIdSub, kPdoInvalid) & kPdoInvalid) != 0;
  std::uint32_t number = 0;
  if (!value.empty()) std::memcpy(&number, value.data(), std::min(value.size(), sizeof number));
  if (object.is_mapping) return check_mapping_write(dictionary, object, address, is_off, number);
  return check_parameter_write(address.sub, is_off, read_u32(dictionary, address.index, address.sub, 0), number);
}

}  // namespace meltbench::canopen
