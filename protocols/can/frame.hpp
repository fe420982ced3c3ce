#pragma once
/// One CAN frame of any kind: classic or FD, standard or extended identifier, data, remote or error.

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <span>

#include "protocols/time/instant.hpp"

namespace meltbench::can {

inline constexpr std::size_t kMaxClassicLength = 8;
inline constexpr std::size_t kMaxFdLength = 64;
inline constexpr std::uint32_t kMaxStandardId = 0x7FF;
inline constexpr std::uint32_t kMaxExtendedId = 0x1FFF'FFFF;

/// What kind of frame this is on the wire. An error frame carries the error class bits of linux/can/error.h as its id.
enum class FrameKind : std::uint8_t { kData, kRemote, kError };

/// A CAN frame by value. Invariants, kept by is_valid(): id fits its width; length <= 8 (classic) or one of the FD
/// lengths 0..8, 12, 16, 20, 24, 32, 48, 64; remote and error frames are classic; brs and esi only with fd.
struct CanFrame {
  std::uint32_t id = 0;  ///< 11 or 29 bits, without flags; for an error frame the error class bits.
  FrameKind kind = FrameKind::kData;
  bool extended = false;     ///< 29-bit identifier.
  bool fd = false;           ///< CAN FD frame format.
  bool brs = false;          ///< FD: data phase at the data bit rate.
  bool esi = false;          ///< FD: sender is error-passive.
  std::uint8_t length = 0;   ///< Data bytes; for a remote frame the number asked for.
  std::uint8_t raw_dlc = 0;  ///< 9..15 for a classic 8-byte frame sent with such a DLC, else 0.
  std::array<std::uint8_t, kMaxFdLength> bytes{};

  [[nodiscard]] std::span<const std::uint8_t> data() const {
    return {bytes.data(), kind == FrameKind::kRemote ? 0U : length};
  }
  bool operator==(const CanFrame& other) const;
};

/// A frame and when it was on the wire: sent or received, as the holder says.
struct StampedFrame {
  Instant at;
  CanFrame frame;
  bool operator==(const StampedFrame&) const = default;
};

/// Classic data frame with an 11-bit id. @pre id <= 0x7FF, at most 8 bytes; a larger id is cut to 11 bits, more bytes
/// to 8.
[[nodiscard]] CanFrame make_frame(std::uint32_t id, std::span<const std::uint8_t> data);
[[nodiscard]] CanFrame make_frame(std::uint32_t id, std::initializer_list<std::uint8_t> data);

/// True if the frame can exist on a bus (the invariants of CanFrame hold).
[[nodiscard]] bool is_valid(const CanFrame& frame);

/// Smallest legal FD length >= length: 9 -> 12, 33 -> 48. @pre length <= 64.
[[nodiscard]] std::uint8_t round_up_to_fd_length(std::size_t length);

/// Data length code 0..15 of an FD length, and back. @pre length is an FD length; dlc <= 15.
[[nodiscard]] std::uint8_t to_fd_dlc(std::size_t length);
[[nodiscard]] std::uint8_t from_fd_dlc(std::size_t dlc);

}  // namespace meltbench::can
