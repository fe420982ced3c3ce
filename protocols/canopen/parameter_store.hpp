#pragma once
/// What 0x1010 saves and 0x1011 gives back: parameter values that survive a reset, as a byte image without files.

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "protocols/canopen/object_dictionary.hpp"

namespace meltbench::canopen {

/// Sub-index of 0x1010 and 0x1011.
enum class ParameterGroup : std::uint8_t {
  kAll = 1,
  kCommunication = 2,  ///< 0x1000..0x1FFF.
  kApplication = 3,    ///< 0x6000..0x9FFF.
  kManufacturer = 4,   ///< 0x2000..0x5FFF.
};

/// Signatures that a master writes: "save" and "load", least significant byte first.
inline constexpr std::uint32_t kSaveSignature = 0x6576'6173;
inline constexpr std::uint32_t kLoadSignature = 0x6461'6F6C;

[[nodiscard]] bool is_in_group(std::uint16_t index, ParameterGroup group);

/// Non-volatile memory of one node. Parameters are the objects that the bus may write and that are not commands or
/// process data: rw and rwr, without 0x1003, 0x1010 and 0x1011 (rww is process data, wo a command).
class ParameterStore {
 public:
  void save(const ObjectDictionary& dictionary, ParameterGroup group);
  void forget(ParameterGroup group);

  /// Writes the stored value, or else the default, to every object of the group that the bus may write.
  void restore(ObjectDictionary& dictionary, ParameterGroup group) const;

  /// The memory as bytes that an application can keep, and the way back. A torn or foreign image is refused as a whole.
  [[nodiscard]] std::vector<std::uint8_t> to_image() const;
  [[nodiscard]] bool load_image(std::span<const std::uint8_t> image);

 private:
  std::map<ObjectAddress, std::vector<std::uint8_t>> values_;
};

}  // namespace meltbench::canopen
