#include <atomic>
#include <catch2/catch.hpp>
#include <cstdlib>
#include <new>

#include "tests/controller/machine/fake_rig.hpp"

namespace {

std::atomic<std::uint64_t> allocation_count{0};

}  // namespace

// Replace the program's, every form, so that each block is freed as it was made: every allocation is counted.
void* operator new(std::size_t size, const std::nothrow_t&) noexcept {
  ++allocation_count;
  return std::malloc(size);
}
void* operator new(std::size_t size) {
  if (void* memory = operator new(size, std::nothrow)) return memory;
  throw std::bad_alloc{};
}
void* operator new[](std::size_t size) {
  return operator new(size);
}
void* operator new[](std::size_t size, const std::nothrow_t&) noexcept {
  return operator new(size, std::nothrow);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete(void* memory, const std::nothrow_t&) noexcept {
  std::free(memory);
}
void operator delete[](void* memory) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, const std::nothrow_t&) noexcept {
  std::free(memory);
}

namespace meltbench::machine::testing {

std::uint64_t count_allocations() {
  return allocation_count;
}

}  // namespace meltbench::machine::testing

using meltbench::machine::testing::FakeRig;

TEST_CASE("Controller: a running cycle allocates nothing", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  const auto before = rig.allocations;
  CHECK(before > 0);  // The boot does: the count works.
  rig.run_for_s(6.0);
  CHECK(rig.allocations == before);
}
