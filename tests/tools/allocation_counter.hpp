#pragma once

#include <cstdint>

namespace meltbench::test {

/// Allocations of the calling thread so far. Only in programs that link allocation_counter.cpp, which replaces the
/// program's operator new.
[[nodiscard]] std::uint64_t count_allocations();

}  // namespace meltbench::test
