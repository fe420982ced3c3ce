#include "plant_emulator/melt_plant.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using emulator::MeltPlant;
using emulator::MeltPlantSettings;
using emulator::MeltStart;

namespace {

double signal(const MeltPlant& plant, std::string_view name) {
  std::vector<double> values(plant.signals().size());
  plant.read_signals(values);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (plant.signals()[i].name == name) return values[i];
  }
  throw std::out_of_range(std::string{name});
}

void run(MeltPlant& plant, Instant to, Nanos step) {
  for (Instant t{step}; t <= to; t += step) {
    plant.advance_to(t);
    plant.settle(t);
  }
}

}  // namespace

TEST_CASE("Melt plant: started steady, it stays so", "[emulator][melt]") {
  MeltPlantSettings settings;
  settings.start = MeltStart::kSteady;
  settings.start_front_m = 0.05;
  MeltPlant plant{settings};
  run(plant, Instant{20s}, 10ms);
  CHECK(plant.front_m() == Approx(0.05).margin(1e-5));  // As the model itself holds it.
  CHECK(signal(plant, "melt.T_inlet_degC") == Approx(131.8216).margin(1e-3));
  CHECK(signal(plant, "melt.q_f_W_per_m2") == Approx(-27.146).margin(1e-2));
}

TEST_CASE("Melt plant: when it is looked at changes where the front is by the solver's error only",
          "[emulator][melt]") {
  MeltPlantSettings settings;
  settings.speed_m_per_s = 0.01;
  settings.numerics.grid_speed_m_per_s = 0.01;
  MeltPlant seldom{settings}, often{settings};
  for (int k = 1; k <= 300; ++k) {
    const Instant t{k * 10ms};
    seldom.advance_to(t);
    for (int part = 9; part >= 0; --part) {
      often.advance_to(t - part * 1ms);
      static_cast<void>(often.front_m());
    }
    if (k == 100) {
      for (MeltPlant* plant : {&seldom, &often}) plant->set_inlet(plant::MeltInlet::local_loop(-4.4, 9000, 125));
    }
  }
  // Implicit Euler at b dt = 0.1 mm against 0.01 mm: 0.053 - 0.039 mm on the doublet.
  CHECK(seldom.front_m() == Approx(often.front_m()).margin(5e-5));
  CHECK(seldom.inlet_flux().total_J_per_m2 == Approx(often.inlet_flux().total_J_per_m2).epsilon(0.02));
}

TEST_CASE("Melt plant: between solutions the front goes straight on, and the flux is counted", "[emulator][melt]") {
  MeltPlantSettings settings;
  settings.start = MeltStart::kSteady;
  settings.start_front_m = 0.05;
  MeltPlant plant{settings};
  plant.set_inlet(plant::MeltInlet::flux(500));
  run(plant, Instant{1s}, 10ms);
  CHECK(plant.inlet_flux().total_J_per_m2 == Approx(500).epsilon(1e-9));
  plant.advance_to(Instant{1s} + 4ms);
  CHECK(plant.inlet_flux().total_J_per_m2 == Approx(502).epsilon(1e-9));
}

TEST_CASE("Melt plant: the screw's speed is the speed of the granules", "[emulator][melt]") {
  MeltPlant plant{MeltPlantSettings{}};
  plant.set_screw_rev_per_s(0.5);
  run(plant, Instant{2s}, 10ms);
  CHECK(plant.encoder_rev() == Approx(1.0));
  CHECK(signal(plant, "plant.speed_m_per_s") == Approx(0.005));
  CHECK(signal(plant, "plant.conveyed_m") == Approx(0.01));
}

TEST_CASE("Melt plant: a lost phase is told once, and flux no longer goes anywhere", "[emulator][melt]") {
  MeltPlantSettings settings;
  settings.speed_m_per_s = 0.01;
  settings.numerics.grid_speed_m_per_s = 0.01;
  MeltPlant plant{settings};
  plant.set_inlet(plant::MeltInlet::flux(-2000));  // Cools: the front runs to the nozzle.
  Outbox out;
  for (int k = 1; k <= 2000; ++k) {
    plant.advance_to(Instant{k * 10ms});
    plant.settle(Instant{k * 10ms});
    plant.report(Instant{k * 10ms}, out);
  }
  REQUIRE(out.events().size() == 1);
  CHECK(out.events()[0].code == "melt-lost");
  CHECK(out.events()[0].severity == Severity::kFault);
  CHECK(plant.inlet_flux().now_W_per_m2 == 0.0);
}

TEST_CASE("Melt plant: the recorded profile is the field of the model", "[emulator][melt]") {
  MeltPlantSettings settings;
  settings.start = MeltStart::kSteady;
  settings.start_front_m = 0.05;
  MeltPlant plant{settings};
  const plant::MeltSteadyState steady = plant::calc_melt_steady_state(settings.melt, 145, 0.002, 0.05);
  for (const int i : {0, 7, 20, 27, 40}) {
    const double x_m = 0.1 * i / (emulator::kProfilePoints - 1);
    const double T_degC = x_m <= 0.05 ? steady.T_solid_degC(x_m) : steady.T_liquid_degC(x_m);
    CHECK(signal(plant, "melt.T_" + std::string(i < 10 ? "0" : "") + std::to_string(i) + "_degC") ==
          Approx(T_degC).margin(0.01));  // Linear between nodes.
  }
}
