#pragma once
/// Process data objects: parameters and mapping from the dictionary, checked as a master changes them.

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/canopen/types.hpp"

namespace meltbench::canopen {

/// Seen from the node.
enum class PdoDirection : std::uint8_t { kReceive, kTransmit };

/// First index of the communication parameters and of the mapping of this direction.
[[nodiscard]] constexpr std::uint16_t pdo_parameter_index(PdoDirection direction) {
  return direction == PdoDirection::kReceive ? 0x1400 : 0x1800;
}
[[nodiscard]] constexpr std::uint16_t pdo_mapping_index(PdoDirection direction) {
  return direction == PdoDirection::kReceive ? 0x1600 : 0x1A00;
}

inline constexpr std::uint16_t kMaxPdoCount = 512;
inline constexpr std::uint32_t kPdoInvalid = 0x8000'0000;   ///< Bit of the COB-ID: switched off.
inline constexpr std::uint32_t kPdoNoRemote = 0x4000'0000;  ///< May not be asked for by a remote frame.
inline constexpr std::uint32_t kCobIdExtended = 0x2000'0000;

/// Transmission types.
inline constexpr std::uint8_t kSyncAcyclic = 0;
inline constexpr std::uint8_t kLastSyncCyclic = 240;
inline constexpr std::uint8_t kEventManufacturer = 254;
inline constexpr std::uint8_t kEventProfile = 255;

/// One PDO's content: where its bytes come from or go to. Mapping is byte-granular, so there are at most 8 items.
class PdoMapping {
 public:
  [[nodiscard]] std::uint8_t length() const { return length_; }  ///< Bytes.

  /// Copies the mapped values into a frame's bytes. @pre 8 bytes.
  void gather(std::uint8_t* bytes) const;
  /// Copies a frame's bytes into the mapped values, gaps skipped. @pre length() bytes.
  void scatter(const std::uint8_t* bytes) const;

  /// Appends an object of so many bits. @returns why it cannot be mapped.
  AbortCode append(ObjectDictionary& dictionary, PdoDirection direction, std::uint32_t map_entry);

 private:
  struct Item {
    std::uint8_t* value = nullptr;  // nullptr: a gap.
    std::uint8_t size = 0;
  };
  std::array<Item, 8> items_{};
  std::uint8_t count_ = 0;
  std::uint8_t length_ = 0;
};

/// One PDO of a node: its parameters as they are in the dictionary, resolved.
struct Pdo {
  unsigned number = 0;  ///< From 1: TPDO1 is 0x1800.
  bool active = false;  ///< Valid COB-ID and something mapped.
  std::uint32_t id = 0;
  bool extended = false;
  bool remote_allowed = false;
  std::uint8_t type = kEventProfile;
  Nanos inhibit_time{};
  Nanos event_time{};  ///< TPDO: longest pause; RPDO: deadline. 0 = off.
  std::uint8_t sync_start = 0;
  PdoMapping mapping;

  [[nodiscard]] bool is_synchronous() const { return type <= kLastSyncCyclic; }
};

/// The PDOs of one direction that the dictionary has, inactive ones too.
/// @throws std::invalid_argument naming the object and why, if the dictionary's values do not fit together.
[[nodiscard]] std::vector<Pdo> read_pdos(ObjectDictionary& dictionary, PdoDirection direction);

/// Reads one PDO again after a change. @pre its objects exist. @returns why not (a bad mapping), then it is inactive.
AbortCode read_pdo(ObjectDictionary& dictionary, PdoDirection direction, Pdo& pdo);

/// True if the address belongs to a PDO's parameters or mapping.
[[nodiscard]] bool is_pdo_object(std::uint16_t index);

/// May this value be written to a PDO's parameters or mapping now? The remap rule of CiA 301: a PDO is switched off
/// (bit 31) before its COB-ID, inhibit time, SYNC start value or mapping change, and the mapping is closed (sub 0 = 0)
/// while its entries are written. @pre is_pdo_object(address.index), and the value has the object's size.
[[nodiscard]] AbortCode check_pdo_write(ObjectDictionary& dictionary, ObjectAddress address,
                                        std::span<const std::uint8_t> value);

}  // namespace meltbench::canopen
