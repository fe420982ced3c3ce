#pragma once
/// How long frames can take on a CAN bus at worst: the classical analysis, beside what BitTimedBus simulates.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "protocols/time/instant.hpp"

namespace meltbench::bus {

/// Frames of one identifier that come again and again.
struct PeriodicFrame {
  std::uint32_t key = 0;  ///< can::arbitration_key(): the smaller, the higher its priority; no two alike.
  Nanos on_wire{};        ///< C: the longest that one of them takes, from start of frame to end of frame.
  Nanos period{};         ///< T > 0: shortest time between two of them.
  Nanos jitter{};         ///< J >= 0: so much later than its period says it can be queued.
};

/// Worst time from being queued to the last bit of end of frame, for every frame; nothing where the bus has no time
/// left for it (the frames from its priority up take all of it).
///
/// For frames whose nodes send by priority, on a bus without errors. With C' = C + 3 bits of interframe space, hp(m)
/// the frames of higher priority than m, B_m the largest C' of those of lower priority, tau one bit:
///
///   t_m = B_m + sum over k in hp(m) and m of ceil((t_m + J_k) / T_k) C'_k                (busy period)
///   w_m(q) = B_m + q C'_m + sum over k in hp(m) of ceil((w_m(q) + J_k + tau) / T_k) C'_k
///   R_m = max over q < ceil((t_m + J_m) / T_m) of w_m(q) - q T_m + C_m
///
/// Davis, Burns, Bril, Lukkien 2007 (see can::calc_longest_frame), Section 3.2, Eq. (4) to (10), which corrects
/// Tindell, Hansson and Wellings 1994; the paper's R_m counts J_m and the interframe space behind m, too. Cost: n
/// frames, some rounds per frame and instance: microseconds for a machine's bus. @param bit_time tau > 0.
[[nodiscard]] std::vector<std::optional<Nanos>> calc_response_bounds(std::span<const PeriodicFrame> frames,
                                                                     Nanos bit_time);

}  // namespace meltbench::bus
