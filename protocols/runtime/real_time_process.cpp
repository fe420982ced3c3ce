#include "protocols/runtime/real_time_process.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <malloc.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "protocols/link/can_link.hpp"
#include "protocols/link/unique_fd.hpp"

namespace meltbench::runtime {
namespace {

constexpr std::size_t kStackBytes = 256 * 1024;            // Far more than the deepest loop of ours takes.
constexpr std::size_t kHeapBytes = std::size_t{16} << 20;  // More than all that is got once the loop runs.

/// Not inlined: the array must lie where the loop's frames will lie.
[[gnu::noinline]] void touch_stack() {
  std::array<char, kStackBytes> room;
  volatile char* const first = room.data();
  constexpr std::size_t kPage = 4096;
  for (std::size_t at = 0; at < room.size(); at += kPage) first[at] = 0;
}

/// Locked memory is in RAM as soon as it is there, and what is given back stays with the heap. The write keeps the
/// compiler from leaving both out.
void touch_heap() {
  auto* const room = static_cast<volatile char*>(std::malloc(kHeapBytes));
  if (room != nullptr) *room = 0;
  std::free(const_cast<char*>(room));
}

void lock_memory() {
  if (::mlockall(MCL_CURRENT | MCL_FUTURE) != 0) {
    throw link::LinkError{fmt::format("cannot lock memory: {}", std::strerror(errno)),
                          "\"meltbench doctor\" says how a user may lock memory; without --rt nothing is locked"};
  }
  // What the heap once had stays with it: giving memory back and getting it again costs page faults.
  ::mallopt(M_TRIM_THRESHOLD, -1);
  ::mallopt(M_MMAP_MAX, 0);
  touch_heap();
  touch_stack();
}

/// A processor that comes out of a deep sleep is late by up to some 100 us. The wish lasts as long as the file is open.
void keep_processors_awake() {
  static const link::UniqueFd wish{::open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC)};
  constexpr std::int32_t kLatency_us = 0;
  if (wish) static_cast<void>(!::write(wish.get(), &kLatency_us, sizeof kLatency_us));
}

}  // namespace

void take_priority(int priority) {
  const sched_param parameter{.sched_priority = priority};
  if (::sched_setscheduler(0, SCHED_FIFO, &parameter) == 0) return;
  throw link::LinkError{fmt::format("cannot run at SCHED_FIFO priority {}: {}", priority, std::strerror(errno)),
                        "\"meltbench doctor\" says how a user gets real-time priorities; without --rt it runs at the "
                        "scheduling of the user"};
}

void become_real_time(int priority) {
  lock_memory();
  take_priority(priority);
  keep_processors_awake();
}

}  // namespace meltbench::runtime
