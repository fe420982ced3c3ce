#pragma once
/// Databases of CAN messages (DBC, Vector's text format): names and values of frames that are not CANopen.

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/can/frame.hpp"

namespace meltbench::decode {

/// How the bits of a signal are a number.
enum class DbcNumber : std::uint8_t { kUnsigned, kSigned, kFloat, kDouble };

struct DbcSignal {
  std::string name;
  unsigned start = 0;        ///< Intel: the least significant bit. Motorola: the most significant. 8 * byte + bit.
  unsigned length = 1;       ///< 1..64 bits.
  bool is_motorola = false;  ///< Most significant bit first, which goes on at bit 7 of the next byte.
  DbcNumber number = DbcNumber::kUnsigned;
  double factor = 1.0;
  double offset = 0.0;
  std::string unit;
  bool is_selector = false;                     ///< M: its raw value says which of the others are there.
  std::optional<std::uint64_t> selected_by{};   ///< mN: only there if the selector is N.
  std::map<std::int64_t, std::string> texts{};  ///< VAL_: what raw values mean.
};

struct DbcMessage {
  std::string name;
  std::uint32_t id = 0;
  bool is_extended = false;
  std::size_t length = 0;  ///< Bytes, 0..64.
  std::vector<DbcSignal> signals{};
};

/// A signal in a frame.
struct DbcValue {
  const DbcSignal* signal = nullptr;
  std::uint64_t raw = 0;  ///< The bits; of kSigned with the sign in all bits above.
  double value = 0.0;     ///< raw * factor + offset.
};

/// What a DBC says.
class Dbc {
 public:
  /// @returns false if there is one with this identifier.
  bool add(DbcMessage message);
  /// nullptr if there is none, and for a frame that is not of data. Valid as long as this.
  [[nodiscard]] const DbcMessage* find(const can::CanFrame& frame) const;
  [[nodiscard]] DbcMessage* find(std::uint32_t id, bool is_extended);
  [[nodiscard]] std::size_t size() const { return messages_.size(); }

 private:
  std::map<std::uint64_t, DbcMessage> messages_;
};

/// Reads a DBC: BO_, SG_ (with M and mN), VAL_ and SIG_VALTYPE_; all other keywords are skipped. Text that is not UTF-8
/// is taken for ISO 8859-1, in which such files write degrees.
///
/// Strict: a name or identifier twice in its place, a signal outside of its message or over another one, mN without M
/// and multiplexors that are multiplexed themselves are errors.
/// @param file_name  only for messages.
/// @throws config::ConfigError at the first line that is wrong. Never anything else, whatever the bytes.
[[nodiscard]] Dbc read_dbc(std::string_view text, std::string_view file_name);

/// The signals that are there: those that the selector selects and that the data is long enough for, in the order of
/// the file.
[[nodiscard]] std::vector<DbcValue> decode_message(const DbcMessage& message, std::span<const std::uint8_t> data);

/// "Motor: Speed=1234.5 rpm, Gear=3 (third)". An integer that is not scaled is exact, else 15 digits.
[[nodiscard]] std::string describe_message(const DbcMessage& message, std::span<const std::uint8_t> data);

}  // namespace meltbench::decode
