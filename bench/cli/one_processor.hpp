#pragma once

#include <sched.h>

#include <cstddef>

namespace meltbench::cli {

/// Keeps this process on one processor, together with the children that are told the same: in lockstep they never run
/// at once, and a message between two processors takes ten times as long.
class OneProcessor {
 public:
  OneProcessor() : cpu_{::sched_getcpu()} {
    ::sched_getaffinity(0, sizeof(before_), &before_);
    cpu_set_t set;
    CPU_ZERO(&set);
    CPU_SET(static_cast<std::size_t>(cpu_), &set);
    ::sched_setaffinity(0, sizeof(set), &set);
  }
  ~OneProcessor() { ::sched_setaffinity(0, sizeof(before_), &before_); }
  OneProcessor(const OneProcessor&) = delete;
  OneProcessor& operator=(const OneProcessor&) = delete;
  [[nodiscard]] int cpu() const { return cpu_; }

 private:
  int cpu_;
  cpu_set_t before_{};
};

}  // namespace meltbench::cli
