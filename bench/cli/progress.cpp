#include "bench/cli/progress.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>

namespace meltbench::cli {
namespace {

constexpr auto kDrawPeriod = std::chrono::milliseconds{100};
constexpr int kBarWidth = 24;

}  // namespace

Progress::Progress(std::string label, Nanos duration, bool quiet)
    : label_{std::move(label)},
      duration_{duration},
      enabled_{!quiet && ::isatty(STDERR_FILENO) == 1},
      start_{std::chrono::steady_clock::now()},
      next_draw_{start_ + kDrawPeriod} {}

Progress::~Progress() {
  clear();
}

void Progress::at(Instant now) {
  if (!enabled_) return;
  const auto clock = std::chrono::steady_clock::now();
  if (clock < next_draw_) return;
  next_draw_ = clock + kDrawPeriod;
  shown_ = true;
  const double done = duration_ > 0ns ? to_s(now) / to_s(duration_) : 1.0;
  const auto filled = static_cast<std::size_t>(done * kBarWidth);
  const double factor = to_s(now) / std::chrono::duration<double>(clock - start_).count();
  fmt::print(stderr, "\r\x1b[K{}  [{:-<{}}] {:.1f} of {:.1f} s  {:.0f} x real time", label_,
             std::string(std::min<std::size_t>(filled, kBarWidth), '#'), kBarWidth, to_s(now), to_s(duration_), factor);
  std::fflush(stderr);
}

void Progress::clear() {
  if (!shown_) return;
  shown_ = false;
  fmt::print(stderr, "\r\x1b[K");
  std::fflush(stderr);
}

}  // namespace meltbench::cli
