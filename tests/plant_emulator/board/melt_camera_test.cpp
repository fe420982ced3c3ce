#include "plant_emulator/board/melt_camera.hpp"

#include <catch2/catch.hpp>

#include "tests/plant_emulator/board/board_bench.hpp"

using namespace meltbench;
using board::field;
using board::kNode;

namespace {

struct CameraBench : board::BoardBench<board::MeltCamera> {
  explicit CameraBench(const board::MeltCameraSettings& settings = {}, std::uint64_t seed = 1)
      : BoardBench{"melt_camera", settings, seed} {
    process.front_at = [](double t_s) { return 0.02 + 1e-3 * t_s; };  // The values tell when the image was taken.
    process.T_inlet_at = [](double t_s) { return 100.0 + t_s; };
    start_operational();
  }
  can::CanFrame front() {
    sync();
    return last(0x180 + kNode).value();
  }
};

}  // namespace

TEST_CASE("Melt camera: both reports carry the values at SYNC minus the age of one image", "[board][melt_camera]") {
  board::MeltCameraSettings settings;
  settings.front_resolution_m = 0;
  settings.resolution_K = 0;
  CameraBench bench{settings};
  for (int k = 4; k <= 200; ++k) {
    bench.run_to(Instant{k * 10ms});
    const can::CanFrame front = bench.front();
    const can::CanFrame inlet = bench.last(0x280 + kNode).value();
    REQUIRE(field<std::uint16_t>(front, 6) == field<std::uint16_t>(inlet, 6));
    REQUIRE(front.bytes[5] == inlet.bytes[5]);
    const double taken_at_s = to_s(bench.now) - field<std::uint16_t>(front, 6) * 1e-5;
    REQUIRE(field<std::int32_t>(front, 0) == Approx((0.02 + 1e-3 * taken_at_s) * 1e6).margin(0.6));  // Whole um.
    REQUIRE(field<std::int32_t>(inlet, 0) == Approx((100.0 + taken_at_s) * 1e3).margin(0.6));        // Whole mK.
    REQUIRE(front.bytes[4] == 0);
    REQUIRE(field<std::uint16_t>(front, 6) >= 1000);  // Latency 10 ms.
    REQUIRE(field<std::uint16_t>(front, 6) < 3000);   // And less than one period of 20 ms more.
  }
}

TEST_CASE("Melt camera: before the first image is ready, nothing is valid", "[board][melt_camera]") {
  CameraBench bench;
  CHECK(bench.front().bytes[4] == board::kNotValid);
}

TEST_CASE("Melt camera: values come in the steps of the camera", "[board][melt_camera]") {
  CameraBench bench;
  for (int k = 4; k <= 100; ++k) {
    bench.run_to(Instant{k * 10ms});
    REQUIRE(field<std::int32_t>(bench.front(), 0) % 10 == 0);
    REQUIRE(field<std::int32_t>(bench.last(0x280 + kNode).value(), 0) % 100 == 0);
  }
}

TEST_CASE("Melt camera: in a drop-out the last good image stays, ages and is marked", "[board][melt_camera]") {
  board::MeltCameraSettings settings;
  settings.drop_out_probability = 0.05;
  settings.drop_out_images = 3;
  CameraBench bench{settings};
  can::CanFrame before = bench.front();
  int marked = 0;
  for (int k = 2; k <= 5000; ++k) {
    bench.run_to(Instant{k * 20ms});
    const can::CanFrame now = bench.front();
    if (k > 3 && now.bytes[4] == board::kNotValid) {
      ++marked;
      REQUIRE(field<std::int32_t>(now, 0) == field<std::int32_t>(before, 0));
      REQUIRE(now.bytes[5] == before.bytes[5]);
      REQUIRE(field<std::uint16_t>(now, 6) >= field<std::uint16_t>(before, 6) + 2000U);
    }
    before = now;
  }
  // An image is lost unless none of three begins a drop-out: 1 - 0.95^3 = 14.3 %; 5000 images, 4 sigma of runs of 3.
  CHECK(marked == Approx(713).margin(170));
  CHECK(bench.read<std::uint32_t>(0x2004) == Approx(marked).margin(4));
}

TEST_CASE("Melt camera: where no front is to be seen its channel is not valid, the other one is",
          "[board][melt_camera]") {
  CameraBench bench;
  bench.process.front_at = [](double) { return board::Process::kNothing; };
  bench.run_to(Instant{100ms});
  CHECK(bench.front().bytes[4] == board::kNotValid);
  CHECK(bench.last(0x280 + kNode).value().bytes[4] == 0);
}
