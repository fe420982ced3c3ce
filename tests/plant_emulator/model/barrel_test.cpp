#include "plant_emulator/model/barrel.hpp"

#include <catch2/catch.hpp>
#include <cmath>

using namespace meltbench::plant;

namespace {

/// Two zones that do not touch: each has a closed form.
BarrelParameters make_isolated() {
  BarrelParameters p = BarrelParameters::with_zones(1);
  p.zones[0].to_next_W_per_K = 0;
  return p;
}

}  // namespace

TEST_CASE("Barrel: a zone with constant power warms as three lags in a row", "[model][barrel]") {
  const BarrelParameters p = make_isolated();
  const HeatedZone& zone = p.zones[0];
  Barrel barrel{p, 25.0};
  barrel.set_heater_W(0, 240.0);
  const double rise_K = 240.0 / zone.to_ambient_W_per_K;
  const double a = zone.heat_capacity_J_per_K / zone.to_ambient_W_per_K, b = zone.heater_lag_s,
               c = zone.thermocouple_lag_s;
  for (int k = 1; k <= 60; ++k) {
    barrel.advance(10.0);
    const double t = 10.0 * k;
    // Step response of 1/((1 + a p)(1 + b p)(1 + c p)).
    const double share = 1 - a * a / ((a - b) * (a - c)) * std::exp(-t / a) -
                         b * b / ((b - a) * (b - c)) * std::exp(-t / b) -
                         c * c / ((c - a) * (c - b)) * std::exp(-t / c);
    // RK4: (0.25 s / 6 s)^4 of the fast lag.
    REQUIRE(barrel.T_thermocouple_degC(0) == Approx(25.0 + rise_K * share).margin(3e-6 * rise_K));
  }
}

TEST_CASE("Barrel: energy from the wires is in the steel, lost or in the polymer", "[model][barrel]") {
  Barrel barrel{BarrelParameters::with_zones(4), 25.0};
  for (int k = 0; k < 6000; ++k) {
    for (std::size_t zone = 0; zone < 5; ++zone)
      barrel.set_heater_W(zone, (k / 70 + static_cast<int>(zone)) % 3 * 150.0);
    barrel.set_to_polymer_W(2, k > 1000 ? 80.0 : 0.0);
    barrel.advance(0.1 + 0.01 * (k % 7));
  }
  CHECK(barrel.heated_J() > 3e5);
  CHECK(barrel.energy_residual_J() == Approx(0).margin(1e-9 * barrel.heated_J()));  // Rounding.
}

TEST_CASE("Barrel: a zone without heater is warmed by its neighbours only", "[model][barrel]") {
  Barrel barrel{BarrelParameters::with_zones(4), 25.0};
  for (const std::size_t zone : {std::size_t{0}, std::size_t{2}}) barrel.set_heater_W(zone, 200.0);
  double before = barrel.T_degC(1);
  for (int k = 0; k < 100; ++k) {
    barrel.advance(5.0);
    REQUIRE(barrel.T_degC(1) > before);
    REQUIRE(barrel.T_degC(1) < std::min(barrel.T_degC(0), barrel.T_degC(2)));
    before = barrel.T_degC(1);
  }
  BarrelParameters p = BarrelParameters::with_zones(4);
  p.zones[0].to_next_W_per_K = p.zones[1].to_next_W_per_K = 0;
  Barrel blocked{p, 25.0};
  blocked.set_heater_W(0, 200.0);
  blocked.advance(500.0);
  CHECK(blocked.T_degC(1) == 25.0);
}

TEST_CASE("Barrel: left alone it goes to the temperature of the room", "[model][barrel]") {
  Barrel barrel{BarrelParameters::with_zones(3), 180.0};
  barrel.advance(8000.0);  // 16 time constants.
  for (std::size_t zone = 0; zone < 4; ++zone) CHECK(barrel.T_degC(zone) == Approx(25.0).margin(1e-4));
}

TEST_CASE("Barrel: started in production it stays there", "[model][barrel]") {
  Barrel barrel{BarrelParameters::with_zones(4), 25.0};
  const std::array<double, 5> T{140, 145, 145, 150, 150}, heat{20, 15, 10, 5, 0};
  barrel.start_at(T, heat);
  barrel.advance(600.0);
  for (std::size_t zone = 0; zone < 5; ++zone) CHECK(barrel.T_degC(zone) == Approx(T[zone]).margin(1e-9));
}

TEST_CASE("Barrel: power is cut to what the band can do", "[model][barrel]") {
  Barrel barrel{BarrelParameters::with_zones(4), 25.0};
  barrel.set_heater_W(0, 1e9);
  CHECK(barrel.heater_W(0) == 500.0);
  barrel.set_heater_W(0, -5.0);
  CHECK(barrel.heater_W(0) == 0.0);
}

TEST_CASE("Barrel: parameters out of range are refused by name", "[model][barrel]") {
  BarrelParameters p = BarrelParameters::with_zones(4);
  p.zones[2].heat_capacity_J_per_K = 0;
  CHECK_THROWS_WITH(Barrel(p, 25.0), Catch::Contains("zone 3") && Catch::Contains("heat_capacity_J_per_K"));
}
