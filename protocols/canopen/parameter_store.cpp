#include "protocols/canopen/parameter_store.hpp"

#include <algorithm>

#include "protocols/canopen/sdo.hpp"

namespace meltbench::canopen {
namespace {

// Image: "MBPS", version, then per value index (2), sub (1), length (4), bytes; CRC-16 of all that at the end.
constexpr std::array<std::uint8_t, 5> kHeader{'M', 'B', 'P', 'S', 1};
constexpr std::size_t kValueHead = 7;
constexpr std::size_t kCrcBytes = 2;

bool is_parameter(const EntryInfo& info) {
  const std::uint16_t index = info.address.index;
  const bool is_kept = info.access == AccessType::kReadWrite || info.access == AccessType::kReadWriteRead;
  return is_kept && index != 0x1003 && index != 0x1010 && index != 0x1011;
}

}  // namespace

bool is_in_group(std::uint16_t index, ParameterGroup group) {
  switch (group) {
    case ParameterGroup::kAll:
      return true;
    case ParameterGroup::kCommunication:
      return index >= 0x1000 && index <= 0x1FFF;
    case ParameterGroup::kApplication:
      return index >= 0x6000 && index <= 0x9FFF;
    case ParameterGroup::kManufacturer:
      return index >= 0x2000 && index <= 0x5FFF;
  }
  return false;
}

void ParameterStore::save(const ObjectDictionary& dictionary, ParameterGroup group) {
  for (const auto& [address, entry] : dictionary.entries()) {
    if (!is_in_group(address.index, group) || !is_parameter(entry.info())) continue;
    const auto bytes = entry.bytes();
    values_[address].assign(bytes.begin(), bytes.end());
  }
}

void ParameterStore::forget(ParameterGroup group) {
  std::erase_if(values_, [group](const auto& stored) { return is_in_group(stored.first.index, group); });
}

void ParameterStore::restore(ObjectDictionary& dictionary, ParameterGroup group) const {
  for (auto& [address, entry] : dictionary.entries()) {
    if (!is_in_group(address.index, group) || !is_writable(entry.info().access)) continue;
    const auto stored = values_.find(address);
    const bool usable =
        stored != values_.end() && is_parameter(entry.info()) && entry.check_value(stored->second) == AbortCode::kNone;
    if (usable) {
      entry.assign(stored->second);
    } else {
      entry.restore_default();
    }
  }
}

std::vector<std::uint8_t> ParameterStore::to_image() const {
  std::vector<std::uint8_t> image(kHeader.begin(), kHeader.end());
  for (const auto& [address, value] : values_) {
    const std::size_t at = image.size();
    image.resize(at + kValueHead);
    store(std::span{image}, at, address.index);
    image[at + 2] = address.sub;
    store(std::span{image}, at + 3, static_cast<std::uint32_t>(value.size()));
    image.insert(image.end(), value.begin(), value.end());
  }
  const std::uint16_t crc = calc_crc16(image);
  image.resize(image.size() + kCrcBytes);
  store(std::span{image}, image.size() - kCrcBytes, crc);
  return image;
}

bool ParameterStore::load_image(std::span<const std::uint8_t> image) {
  if (image.size() < kHeader.size() + kCrcBytes || !std::ranges::equal(image.first(kHeader.size()), kHeader))
    return false;
  const auto content = image.first(image.size() - kCrcBytes);
  if (calc_crc16(content) != load<std::uint16_t>(image, content.size())) return false;
  std::map<ObjectAddress, std::vector<std::uint8_t>> values;
  auto rest = content.subspan(kHeader.size());
  while (!rest.empty()) {
    if (rest.size() < kValueHead) return false;
    const ObjectAddress address{load<std::uint16_t>(rest), rest[2]};
    const std::size_t size = load<std::uint32_t>(rest, 3);
    rest = rest.subspan(kValueHead);
    if (size > rest.size()) return false;
    values[address].assign(rest.begin(), rest.begin() + static_cast<std::ptrdiff_t>(size));
    rest = rest.subspan(size);
  }
  values_ = std::move(values);
  return true;
}

}  // namespace meltbench::canopen
