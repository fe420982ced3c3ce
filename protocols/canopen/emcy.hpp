#pragma once
/// Emergency messages: what went wrong in a node, told once when it happens and once when it is over.

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/canopen/types.hpp"

namespace meltbench::canopen {

/// Bits of the error register 0x1001.
namespace error_register {
inline constexpr std::uint8_t kGeneric = 0x01;
inline constexpr std::uint8_t kCurrent = 0x02;
inline constexpr std::uint8_t kVoltage = 0x04;
inline constexpr std::uint8_t kTemperature = 0x08;
inline constexpr std::uint8_t kCommunication = 0x10;
inline constexpr std::uint8_t kProfile = 0x20;
inline constexpr std::uint8_t kManufacturer = 0x80;
}  // namespace error_register

/// Error codes that the protocol itself raises.
namespace emcy_code {
inline constexpr std::uint16_t kNoError = 0x0000;
inline constexpr std::uint16_t kHeartbeat = 0x8130;
inline constexpr std::uint16_t kPdoTooShort = 0x8210;
inline constexpr std::uint16_t kSyncLength = 0x8240;
inline constexpr std::uint16_t kRpdoTimeout = 0x8250;
}  // namespace emcy_code

using ManufacturerBytes = std::array<std::uint8_t, 5>;

/// One emergency message.
struct Emcy {
  std::uint16_t code = 0;
  std::uint8_t error_register = 0;
  ManufacturerBytes manufacturer{};
  bool operator==(const Emcy&) const = default;
};

/// An emergency message as a consumer gets it.
struct ReceivedEmcy {
  std::uint8_t node = 0;
  Emcy emcy;
};

[[nodiscard]] can::CanFrame make_emcy(std::uint32_t id, const Emcy& emcy);

/// Nothing if the frame is not an emergency message on a predefined COB-ID (0x081..0x0FF, 8 bytes).
[[nodiscard]] std::optional<ReceivedEmcy> parse_emcy(const can::CanFrame& frame);

/// Class of an error code in words: "life guard or heartbeat", "device temperature" ...
[[nodiscard]] std::string_view emcy_text(std::uint16_t code);

/// Keeps the node's errors: which are active, the error register 0x1001, the history 0x1003, the messages still to be
/// sent (0x1014 COB-ID, 0x1015 inhibit time). Objects that the dictionary does not have are done without.
class EmcyProducer {
 public:
  /// @param dictionary  must outlive it.
  explicit EmcyProducer(ObjectDictionary& dictionary);

  /// Back to no error: register, history, queue. COB-ID and inhibit time are read from the dictionary again.
  void reset();
  void read_parameters();

  /// An error is there. `instance` (the first manufacturer byte) tells errors of one code apart; one that is active is
  /// not told again. @returns true if it was new.
  bool raise(std::uint16_t code, std::uint8_t register_bits, const ManufacturerBytes& manufacturer);

  /// An error is over: all active ones of the code, or those of one instance. The history stays. Told once, by code
  /// 0000 with what remains in the register. @returns true if there was one.
  bool clear(std::uint16_t code, std::optional<std::uint8_t> instance = {});

  [[nodiscard]] bool is_active(std::uint16_t code) const;
  [[nodiscard]] bool has_pending() const { return !pending_.empty(); }
  [[nodiscard]] Instant next_deadline() const;  ///< When the next message may go; Instant{} = at once.

  /// Sends what the inhibit time allows.
  void send_due(Instant now, Frames& out);

  void clear_history();
  [[nodiscard]] std::uint8_t history_count() const;

 private:
  struct Active {
    std::uint16_t code = 0;
    std::uint8_t instance = 0;
    std::uint8_t register_bits = 0;
  };
  void update_register();
  void push_history(std::uint16_t code, const ManufacturerBytes& manufacturer);
  void queue(const Emcy& emcy);

  OdEntry* register_ = nullptr;
  OdEntry* cob_id_ = nullptr;
  OdEntry* inhibit_ = nullptr;
  std::vector<OdEntry*> history_;  // Sub 0 (count), then the newest first.
  std::vector<Active> active_;
  std::vector<Emcy> pending_;
  std::uint8_t error_register_ = 0;
  Nanos inhibit_time_{};
  Instant next_allowed_{};
};

}  // namespace meltbench::canopen
