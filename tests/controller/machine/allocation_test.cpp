#include <catch2/catch.hpp>

#include "tests/controller/machine/fake_rig.hpp"

using meltbench::machine::testing::FakeRig;

TEST_CASE("Controller: a running cycle allocates nothing", "[machine]") {
  FakeRig rig;
  rig.run_for_s(1.0);
  const auto before = rig.allocations;
  CHECK(before > 0);  // The boot does: the count works.
  rig.run_for_s(6.0);
  CHECK(rig.allocations == before);
}
