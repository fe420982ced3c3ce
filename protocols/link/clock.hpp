#pragma once

#include <time.h>

#include "protocols/time/instant.hpp"

namespace meltbench::link {

[[nodiscard]] inline Nanos read_clock(clockid_t clock) noexcept {
  timespec reading{};
  ::clock_gettime(clock, &reading);
  return Nanos{reading.tv_sec * 1'000'000'000LL + reading.tv_nsec};
}

/// CLOCK_MONOTONIC, which all processes of one machine share.
[[nodiscard]] inline Nanos read_monotonic() noexcept {
  return read_clock(CLOCK_MONOTONIC);
}

}  // namespace meltbench::link
