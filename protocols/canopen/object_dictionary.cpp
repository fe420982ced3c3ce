#include "protocols/canopen/object_dictionary.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include <fmt/format.h>

namespace meltbench::canopen {
namespace {

using Bytes = std::span<const std::uint8_t>;

std::uint64_t load_unsigned(Bytes bytes) {
  std::uint64_t value = 0;
  if (!bytes.empty()) std::memcpy(&value, bytes.data(), std::min<std::size_t>(bytes.size(), sizeof value));
  return value;
}

std::int64_t load_signed(Bytes bytes) {
  const unsigned unused_bits = 64 - 8 * static_cast<unsigned>(bytes.size());
  return static_cast<std::int64_t>(load_unsigned(bytes) << unused_bits) >> unused_bits;
}

double load_real(Bytes bytes) {
  return bytes.size() == sizeof(float) ? static_cast<double>(load<float>(bytes)) : load<double>(bytes);
}

/// Order of two values of the type; unordered only if one is a NaN.
std::partial_ordering compare(DataType type, Bytes a, Bytes b) {
  if (is_real(type)) return load_real(a) <=> load_real(b);
  if (is_signed(type)) return load_signed(a) <=> load_signed(b);
  return load_unsigned(a) <=> load_unsigned(b);
}

}  // namespace

OdEntry::OdEntry(EntryInfo info) : info_{std::move(info)}, fixed_size_{static_cast<std::uint8_t>(size_of(info_.type))} {
  const auto refuse = [this](std::string_view what, std::size_t size) {
    throw std::invalid_argument(fmt::format("object {}: {} has {} bytes, {} needs {}", text(info_.address), what, size,
                                            text(info_.type), fixed_size_));
  };
  if (!is_known(info_.type)) {
    throw std::invalid_argument(
        fmt::format("object {}: unknown data type 0x{:04X}", text(info_.address), static_cast<unsigned>(info_.type)));
  }
  default_bytes_ = info_.default_value;
  if (default_bytes_.empty()) default_bytes_.resize(fixed_size_);
  if (check_size(default_bytes_.size()) != AbortCode::kNone) refuse("the default", default_bytes_.size());
  for (const auto& limit : {info_.low_limit, info_.high_limit}) {
    if (limit && (fixed_size_ == 0 || limit->size() != fixed_size_)) refuse("a limit", limit->size());
  }
  restore_default();
}

std::int64_t OdEntry::to_int64() const {
  if (fixed_size_ == 0 || is_real(info_.type)) return 0;
  return is_signed(info_.type) ? load_signed(bytes()) : static_cast<std::int64_t>(load_unsigned(bytes()));
}

std::size_t OdEntry::capacity() const {
  if (fixed_size_ != 0) return fixed_size_;
  return info_.type == DataType::kDomain ? kMaxDomainBytes : kMaxStringBytes;
}

AbortCode OdEntry::check_size(std::size_t size) const {
  if (size > capacity()) return AbortCode::kTooLong;
  if (size < fixed_size_) return AbortCode::kTooShort;
  return AbortCode::kNone;
}

AbortCode OdEntry::check_value(Bytes value) const {
  if (const AbortCode code = check_size(value.size()); code != AbortCode::kNone) return code;
  const auto& [low, high] = std::tie(info_.low_limit, info_.high_limit);
  if ((low || high) && is_real(info_.type) && std::isnan(load_real(value))) return AbortCode::kInvalidValue;
  if (high && compare(info_.type, value, *high) > 0) return AbortCode::kTooHigh;
  if (low && compare(info_.type, value, *low) < 0) return AbortCode::kTooLow;
  return AbortCode::kNone;
}

void OdEntry::assign(Bytes value) {
  if (fixed_size_ != 0) {
    std::copy_n(value.begin(), fixed_size_, number_.begin());
  } else {
    text_.assign(value.begin(), value.end());
  }
}

OdEntry& ObjectDictionary::add(EntryInfo info) {
  const ObjectAddress address = info.address;
  const auto [place, added] = entries_.try_emplace(address, std::move(info));
  if (!added) throw std::invalid_argument(fmt::format("object {} is in the dictionary twice", text(address)));
  return place->second;
}

OdEntry* ObjectDictionary::find(std::uint16_t index, std::uint8_t sub) {
  const auto place = entries_.find({index, sub});
  return place == entries_.end() ? nullptr : &place->second;
}

const OdEntry* ObjectDictionary::find(std::uint16_t index, std::uint8_t sub) const {
  const auto place = entries_.find({index, sub});
  return place == entries_.end() ? nullptr : &place->second;
}

bool ObjectDictionary::has_index(std::uint16_t index) const {
  const auto place = entries_.lower_bound({index, 0});
  return place != entries_.end() && place->first.index == index;
}

OdEntry& ObjectDictionary::at(std::uint16_t index, std::uint8_t sub) {
  if (OdEntry* const entry = find(index, sub)) return *entry;
  throw_absent({index, sub});
}

const OdEntry& ObjectDictionary::at(std::uint16_t index, std::uint8_t sub) const {
  if (const OdEntry* const entry = find(index, sub)) return *entry;
  throw_absent({index, sub});
}

void ObjectDictionary::throw_absent(ObjectAddress address) {
  throw std::out_of_range(fmt::format("no object {} in the dictionary", text(address)));
}

void ObjectDictionary::throw_wrong_type(const OdEntry& entry) {
  throw std::invalid_argument(fmt::format("object {} ({}) is {}: bound as another type", text(entry.address()),
                                          entry.info().name, text(entry.info().type)));
}

std::int64_t ObjectDictionary::integer_or(std::uint16_t index, std::uint8_t sub, std::int64_t otherwise) const {
  const OdEntry* const entry = find(index, sub);
  return entry == nullptr ? otherwise : entry->to_int64();
}

AbortCode ObjectDictionary::check_read(ObjectAddress address) const {
  const OdEntry* const entry = find(address.index, address.sub);
  if (entry == nullptr) return has_index(address.index) ? AbortCode::kNoSubIndex : AbortCode::kNoObject;
  return is_readable(entry->info().access) ? AbortCode::kNone : AbortCode::kWriteOnly;
}

AbortCode ObjectDictionary::check_write(ObjectAddress address, std::optional<std::size_t> size) const {
  const OdEntry* const entry = find(address.index, address.sub);
  if (entry == nullptr) return has_index(address.index) ? AbortCode::kNoSubIndex : AbortCode::kNoObject;
  if (!is_writable(entry->info().access)) return AbortCode::kReadOnly;
  return size ? entry->check_size(*size) : AbortCode::kNone;
}

AbortCode ObjectDictionary::check_write(ObjectAddress address, Bytes value) const {
  const AbortCode code = check_write(address, std::optional{value.size()});
  return code != AbortCode::kNone ? code : at(address.index, address.sub).check_value(value);
}

void ObjectDictionary::allow_dummy(std::uint16_t index, bool allowed) {
  if (index == 0 || index > 7) return;
  const std::uint32_t bit = 1U << index;
  dummies_ = allowed ? dummies_ | bit : dummies_ & ~bit;
}

bool ObjectDictionary::is_dummy_allowed(std::uint16_t index) const {
  return index >= 1 && index <= 7 && (dummies_ >> index & 1U) != 0;
}

}  // namespace meltbench::canopen
