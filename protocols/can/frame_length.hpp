#pragma once

#include <cstdint>

#include "protocols/can/frame.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::can {

/// Bits of interframe space after every frame.
inline constexpr unsigned kIntermissionBits = 3;

/// How long a frame occupies the wire, from start of frame to end of frame, stuff bits counted; the interframe space of
/// kIntermissionBits comes on top.
struct FrameLength {
  std::uint16_t nominal_bits = 0;  ///< At the nominal bit rate.
  std::uint16_t data_bits = 0;     ///< FD with bit rate switch: at the data bit rate.
  bool operator==(const FrameLength&) const = default;
};

/// Exact length of this frame. @pre is_valid(frame), not an error frame. Cost: about 2 ns per bit.
[[nodiscard]] FrameLength calc_frame_length(const CanFrame& frame);

/// Longest that any frame with this format and number of data bytes can be: one stuff bit after the first five bits and
/// then after every four. Used by the response-time bound. Source: R. I. Davis, A. Burns, R. J. Bril, J. J. Lukkien,
/// "Controller Area Network (CAN) schedulability analysis: Refuted, revisited and revised", Real-Time Systems 35 (2007)
/// 239-272, Eq. (1) without its 3 bits of interframe space; FD by the same rule over its dynamically stuffed part.
[[nodiscard]] FrameLength calc_longest_frame(const CanFrame& frame);

/// Time on the wire at these bit times. The interframe space is not in it.
[[nodiscard]] constexpr Nanos time_on_wire(FrameLength length, Nanos bit_time, Nanos data_bit_time) {
  return length.nominal_bits * bit_time + length.data_bits * data_bit_time;
}

}  // namespace meltbench::can
