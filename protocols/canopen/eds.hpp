#pragma once
/// Electronic data sheets (EDS, DCF; CiA 306): the text from which a node's dictionary is built.

#include <cstdint>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/canopen/object_dictionary.hpp"

namespace meltbench::canopen {

/// An EDS that cannot be used. what() is "file:line:column: what is wrong"; hint() says what to do, may be empty.
class EdsError : public std::runtime_error {
 public:
  EdsError(const std::string& what, std::string hint) : std::runtime_error(what), hint_{std::move(hint)} {}
  [[nodiscard]] const std::string& hint() const { return hint_; }

 private:
  std::string hint_;
};

/// [DeviceInfo]: who made it. Missing keys are empty or 0.
struct DeviceInfo {
  std::string vendor_name;
  std::uint32_t vendor_number = 0;
  std::string product_name;
  std::uint32_t product_number = 0;
  std::uint32_t revision_number = 0;
  std::string order_code;
  std::vector<unsigned> bit_rates_kbit_per_s;  ///< Supported ones, rising.
  unsigned rx_pdo_count = 0;
  unsigned tx_pdo_count = 0;
  unsigned granularity = 8;  ///< Bits, of PDO mapping.
  bool lss_supported = false;
};

/// What an EDS says.
struct Eds {
  DeviceInfo device;
  ObjectDictionary dictionary;
  std::vector<std::string> warnings;  ///< "file:line: ..." for what was understood but is not right.
};

/// Reads an EDS or DCF.
///
/// Understands any case of section names, keys and hex digits, CR LF, `;` comments, $NODEID in values, CompactSubObj
/// with its Value and Name sections, ParameterValue (which beats DefaultValue), LowLimit and HighLimit, DummyUsage.
/// Type definitions (DEFTYPE, DEFSTRUCT) are skipped, unknown sections and keys are ignored.
/// @param text       the file's content; at most 4 MiB.
/// @param file_name  only for messages.
/// @param node_id    1..127, what $NODEID stands for.
/// @throws EdsError on the first thing that is wrong. Never anything else, whatever the bytes.
[[nodiscard]] Eds read_eds(std::string_view text, std::string_view file_name, std::uint8_t node_id);

}  // namespace meltbench::canopen
