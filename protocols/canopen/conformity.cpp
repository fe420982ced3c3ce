#include "protocols/canopen/conformity.hpp"

#include <fmt/format.h>

#include "protocols/canopen/pdo.hpp"

namespace meltbench::canopen {
namespace {

using Faults = std::vector<std::string>;

void check_mandatory(const ObjectDictionary& dictionary, Faults& faults) {
  struct Mandatory {
    ObjectAddress address;
    DataType type;
  };
  constexpr std::array<Mandatory, 4> kMandatory{{{{0x1000, 0}, DataType::kUnsigned32},
                                                 {{0x1001, 0}, DataType::kUnsigned8},
                                                 {{0x1018, 0}, DataType::kUnsigned8},
                                                 {{0x1018, 1}, DataType::kUnsigned32}}};
  for (const auto& [address, type] : kMandatory) {
    const OdEntry* const entry = dictionary.find(address.index, address.sub);
    if (entry == nullptr) {
      faults.push_back(fmt::format("{} is mandatory and missing", text(address)));
      continue;
    }
    if (entry->info().type != type) {
      faults.push_back(fmt::format("{} is {}, must be {}", text(address), text(entry->info().type), text(type)));
    }
    if (is_writable(entry->info().access)) faults.push_back(fmt::format("{} must not be writable", text(address)));
  }
  if (!dictionary.has_index(0x1016) && !dictionary.has_index(0x1017)) {
    faults.emplace_back("neither 0x1016 nor 0x1017: a heartbeat consumer or producer is mandatory");
  }
}

/// Highest sub-index of the object that begins at `entry`; 0xFF (the structure of the object) does not count.
std::uint8_t find_highest_sub(const ObjectDictionary& dictionary, std::uint16_t index) {
  std::uint8_t highest = 0;
  for (std::uint8_t sub = 1; sub < 0xFF; ++sub) {
    if (dictionary.find(index, sub) != nullptr) highest = sub;
  }
  return highest;
}

void check_sub_zero(const ObjectDictionary& dictionary, const OdEntry& entry, Faults& faults) {
  const ObjectCode code = entry.info().object_code;
  if (entry.address().sub != 0 || (code != ObjectCode::kArray && code != ObjectCode::kRecord)) return;
  const std::uint16_t index = entry.address().index;
  if (entry.info().type != DataType::kUnsigned8) faults.push_back(fmt::format("0x{:04X}:0 must be UNSIGNED8", index));
  const std::int64_t count = entry.to_int64();
  const std::uint8_t highest = find_highest_sub(dictionary, index);
  const bool counts_what_is_used = index == 0x1003 || (is_pdo_object(index) && (index & 0x200U) != 0);
  if (counts_what_is_used ? count > highest : count != highest) {
    faults.push_back(fmt::format("0x{:04X}:0 is {}, the highest sub-index is {}", index, count, highest));
  }
}

void check_limits(const OdEntry& entry, Faults& faults) {
  const EntryInfo& info = entry.info();
  if (info.low_limit && info.high_limit) {
    if (entry.check_value(*info.low_limit) == AbortCode::kTooHigh) {
      faults.push_back(fmt::format("{}: low limit above the high limit", text(info.address)));
      return;
    }
  }
  const OdEntry as_new{info};
  if (const AbortCode code = entry.check_value(as_new.bytes()); code != AbortCode::kNone) {
    faults.push_back(fmt::format("{}: default: {}", text(info.address), text(code)));
  }
}

void check_pdos(ObjectDictionary& dictionary, PdoDirection direction, Faults& faults) {
  for (unsigned number = 1; number <= kMaxPdoCount; ++number) {
    const auto parameters = static_cast<std::uint16_t>(pdo_parameter_index(direction) + number - 1);
    const auto mapping = static_cast<std::uint16_t>(pdo_mapping_index(direction) + number - 1);
    const bool has_parameters = dictionary.has_index(parameters);
    if (has_parameters != dictionary.has_index(mapping)) {
      faults.push_back(fmt::format("0x{:04X} and 0x{:04X} must both be there, or neither", parameters, mapping));
      continue;
    }
    if (!has_parameters) continue;
    Pdo pdo;
    pdo.number = number;
    if (const AbortCode code = read_pdo(dictionary, direction, pdo); code != AbortCode::kNone) {
      faults.push_back(fmt::format("PDO 0x{:04X} with mapping 0x{:04X}: {}", parameters, mapping, text(code)));
    }
  }
}

}  // namespace

std::vector<std::string> find_conformity_faults(ObjectDictionary& dictionary) {
  Faults faults;
  check_mandatory(dictionary, faults);
  for (const auto& [address, entry] : dictionary.entries()) {
    check_sub_zero(dictionary, entry, faults);
    check_limits(entry, faults);
  }
  check_pdos(dictionary, PdoDirection::kReceive, faults);
  check_pdos(dictionary, PdoDirection::kTransmit, faults);
  return faults;
}

}  // namespace meltbench::canopen
