#include "plant_emulator/model/extruder.hpp"

#include <catch2/catch.hpp>
#include <cmath>

using namespace meltbench;
using namespace meltbench::plant;

namespace {

ExtruderParameters make_parameters(PolymerKind kind = PolymerKind::kHdpe) {
  ExtruderParameters p;
  p.bizone = make_parameters(Preset::kSlow, FluctuationCase::kNone);
  p.bizone.x0_m = 0.08;
  p.set_polymer(make_polymer(kind, 9e4));
  p.numerics.grid_speed_m_per_s = p.bizone.speed_m_per_s;
  p.T_zone_start_degC = p.polymer.melt.T_melt_degC + 10;
  return p;
}

/// Holds a front as a controller with exact knowledge would, by the preconditioner's own loop.
MeltInlet make_inlet(const ExtruderParameters& p, double front_m) {
  const MeltSteadyState steady =
      calc_melt_steady_state(p.polymer.melt, p.T_zone_start_degC, p.bizone.speed_m_per_s, front_m);
  const MeltPhase& solid = p.polymer.melt.solid;
  const double gain = 0.5 * solid.density_kg_per_m3 * solid.heat_capacity_J_per_kgK * p.bizone.speed_m_per_s;
  return MeltInlet::local_loop(steady.inlet_flux_W_per_m2, gain, steady.T_inlet_degC());
}

double feed_for(const Extruder& extruder, double x_m) {
  return extruder.bizone().parameters().holding_feed_kg_per_s(x_m);
}

}  // namespace

TEST_CASE("Extruder: started in production it rests, with every polymer", "[model][extruder]") {
  const PolymerKind kind = GENERATE(PolymerKind::kHdpe, PolymerKind::kPla, PolymerKind::kLdpe);
  const ExtruderParameters p = make_parameters(kind);
  Extruder extruder{p};
  extruder.set_feed_kg_per_s(feed_for(extruder, 0.08));
  extruder.set_inlet(make_inlet(p, 0.08));
  extruder.advance_to(Instant{120s});
  CHECK(extruder.front_m() == Approx(0.08).margin(1e-4));  // The model rests to 1e-5 m a quarter of a minute.
  CHECK(extruder.bizone().x_m() == Approx(0.08).margin(1e-5));
  for (std::size_t zone = 0; zone < 5; ++zone) {
    CHECK(extruder.barrel().T_degC(zone) == Approx(p.T_zone_start_degC).margin(0.01));
  }
  CHECK(extruder.state() == ExtruderState::kConveying);
  CHECK(extruder.barrel().energy_residual_J() == Approx(0).margin(1e-6));
  CHECK(extruder.bizone().outputs().mass_residual_m == Approx(0).margin(1e-8));
}

TEST_CASE("Extruder: one screw moves filled zone and melting front", "[model][extruder]") {
  Extruder extruder{make_parameters()};
  extruder.set_screw_rev_per_s(2.0);  // From 15 to 20 mm/s; feed and flux stay.
  extruder.advance_to(Instant{10s});
  CHECK(extruder.bizone().x_m() < 0.079);  // The nozzle takes more than is fed.
  CHECK(extruder.front_m() > 0.081);       // Granules come faster than they melt.
}

TEST_CASE("Extruder: a barrel zone pays for the polymer that it heats", "[model][extruder]") {
  const ExtruderParameters p = make_parameters();
  Extruder idle{p}, working{p};
  idle.set_feed_kg_per_s(0);  // The channel empties: less polymer to heat.
  working.set_feed_kg_per_s(feed_for(working, 0.08));
  for (Extruder* extruder : {&idle, &working}) {
    extruder->set_inlet(make_inlet(p, 0.08));
    extruder->advance_to(Instant{300s});
  }
  CHECK(idle.barrel().T_degC(1) > working.barrel().T_degC(1) + 1.0);
  // In the balance: 2 kg/h that melt and warm from 132 to 138 degC by latent and sensible heat.
  double heat_W = 0;
  for (std::size_t zone = 0; zone < 5; ++zone) heat_W += working.barrel().to_polymer_W(zone);
  const double flow_kg_per_s = working.bizone().outputs().flow_kg_per_s;
  const double latent_W = flow_kg_per_s * p.polymer.melt.heat_of_fusion_J_per_kg;
  CHECK(heat_W > latent_W);
  CHECK(heat_W < 3 * latent_W);
}

TEST_CASE("Extruder: colder melt is thicker and the pressure rises", "[model][extruder]") {
  const ExtruderParameters p = make_parameters();
  Extruder extruder{p};
  extruder.set_feed_kg_per_s(feed_for(extruder, 0.08));
  extruder.set_inlet(make_inlet(p, 0.08));
  const double before_Pa = extruder.bizone().pressure_Pa();
  const double T_before = extruder.T_nozzle_degC();
  extruder.set_heater_W(3, 0.0);
  extruder.advance_to(Instant{60s});
  const double cooled_K = T_before - extruder.T_nozzle_degC();
  REQUIRE(cooled_K > 0.2);
  const BizoneOutputs out = extruder.bizone().outputs();
  const double expected = std::exp(p.polymer.viscosity.decay_1_per_K * cooled_K) * out.flow_kg_per_s /
                          feed_for(Extruder{p}, 0.08);  // (C5), (D6).
  CHECK(out.pressure_Pa / before_Pa == Approx(expected).epsilon(1e-3));
}

TEST_CASE("Extruder: granules in the filled zone close the nozzle", "[model][extruder]") {
  const ExtruderParameters p = make_parameters();
  Extruder extruder{p};
  extruder.set_feed_kg_per_s(feed_for(extruder, 0.08));
  MeltInlet inlet = make_inlet(p, 0.08);
  inlet.T_reference_degC -= 20;  // Cold granules: the front runs to the nozzle.
  extruder.set_inlet(inlet);
  double highest_Pa = 0;
  double least_opening = 1;
  for (int k = 1; k <= 300; ++k) {
    extruder.advance_to(Instant{k * 100ms});
    highest_Pa = std::max(highest_Pa, extruder.bizone().pressure_Pa());
    least_opening = std::min(least_opening, extruder.nozzle_opening());
    if (extruder.melt_margin_m() > 0) REQUIRE(extruder.nozzle_opening() == 1.0);
  }
  CHECK(extruder.melt_margin_m() < 0);
  CHECK(least_opening == Approx(Extruder::kLeastOpening));
  CHECK(highest_Pa > 2 * 26000);
  CHECK(extruder.bizone().outputs().mass_residual_m == Approx(0).margin(1e-8));
}

TEST_CASE("Extruder: from cold the screw is blocked until the nozzle end is molten", "[model][extruder]") {
  ExtruderParameters p = make_parameters();
  p.starts_cold = true;
  p.bizone.x0_m = 0;
  Extruder extruder{p};
  CHECK(extruder.T_nozzle_degC() == Approx(25));
  for (std::size_t zone = 0; zone < 5; ++zone) extruder.set_heater_W(zone, 240);
  extruder.advance_to(Instant{60s});
  extruder.set_screw_rev_per_s(1.5);
  CHECK(extruder.state() == ExtruderState::kBlocked);
  CHECK(extruder.nozzle_opening() == Extruder::kLeastOpening);
  extruder.set_screw_rev_per_s(0);
  CHECK(extruder.state() == ExtruderState::kStanding);
  extruder.advance_to(Instant{600s});
  CHECK(extruder.T_nozzle_degC() > 140.0);
  extruder.set_inlet(make_inlet(p, 0.08));
  CHECK(extruder.inlet_flux().now_W_per_m2 == 0.0);  // Nothing passes the preconditioner.
  extruder.set_screw_rev_per_s(1.5);
  CHECK(extruder.state() == ExtruderState::kConveying);
  extruder.advance_to(Instant{630s});
  CHECK(extruder.melt().status() == MeltStatus::kRunning);
  CHECK(extruder.front_m() > 0.03);
  CHECK(extruder.melt_margin_m() > 0.0);
}

TEST_CASE("Extruder: it can stop, stand and go on", "[model][extruder]") {
  const ExtruderParameters p = make_parameters();
  Extruder extruder{p};
  extruder.set_feed_kg_per_s(feed_for(extruder, 0.08));
  extruder.set_inlet(make_inlet(p, 0.08));
  extruder.advance_to(Instant{10s});
  extruder.set_screw_rev_per_s(0);
  extruder.set_feed_kg_per_s(0);
  const double front = extruder.front_m();
  CHECK(front == Approx(0.08).margin(0.003));  // A cell of 2.5 mm.
  extruder.advance_to(Instant{15s});
  CHECK(extruder.bizone().pressure_Pa() == 0.0);
  CHECK(extruder.bizone().x_m() == Approx(0.08).margin(1e-4));
  extruder.set_screw_rev_per_s(1.5);
  extruder.set_feed_kg_per_s(feed_for(extruder, 0.08));
  extruder.advance_to(Instant{60s});
  CHECK(extruder.state() == ExtruderState::kConveying);
  CHECK(extruder.melt().status() == MeltStatus::kRunning);
  CHECK(extruder.front_m() == Approx(0.08).margin(0.02));
}

TEST_CASE("Extruder: another polymer in the barrel has its own melting temperature and density", "[model][extruder]") {
  const ExtruderParameters p = make_parameters(PolymerKind::kLdpe);
  Extruder extruder{p};
  extruder.set_feed_kg_per_s(feed_for(extruder, 0.08));
  extruder.advance_to(Instant{5s});
  const double T = extruder.T_degC(0.19);
  extruder.change_polymer(make_polymer(PolymerKind::kHdpe, 9e4));
  CHECK(extruder.T_degC(0.19) == Approx(T).margin(0.2));
  CHECK(extruder.state() == ExtruderState::kBlocked);  // 120 degC do not melt HDPE.
  CHECK(extruder.bizone().parameters().density_kg_per_m3 == 780.0);
  Extruder other{make_parameters(PolymerKind::kHdpe)};
  other.advance_to(Instant{5s});
  other.change_polymer(make_polymer(PolymerKind::kLdpe, 9e4));
  CHECK(other.state() == ExtruderState::kConveying);
  CHECK(other.bizone().x_m() == Approx(0.08).margin(1e-3));
}

TEST_CASE("Extruder: how often it is looked at changes its results by the solver's error only", "[model][extruder]") {
  const ExtruderParameters p = make_parameters();
  Extruder seldom{p}, often{p};
  for (int k = 1; k <= 2000; ++k) {
    const Instant t{k * 10ms};
    seldom.advance_to(t);
    for (const Nanos before : {Nanos{7ms}, Nanos{3ms}, Nanos{10us}}) {
      often.advance_to(t - before);
      static_cast<void>(often.front_m());
      static_cast<void>(often.T_thermocouple_degC(1));
    }
    often.advance_to(t);
    if (k == 500) {
      for (Extruder* extruder : {&seldom, &often}) {
        extruder->set_inlet(make_inlet(p, 0.09));
        extruder->set_heater_W(1, 300);
        extruder->set_screw_rev_per_s(1.6);
      }
    }
  }
  CHECK(seldom.front_m() == Approx(often.front_m()).margin(1e-4));  // b dt = 0.1 mm against 0.04 mm.
  CHECK(seldom.barrel().T_degC(1) == Approx(often.barrel().T_degC(1)).margin(1e-3));
  CHECK(seldom.bizone().x_m() == Approx(often.bizone().x_m()).margin(1e-6));
}

TEST_CASE("Extruder: parameters that do not fit together are refused", "[model][extruder]") {
  ExtruderParameters p = make_parameters();
  p.bizone.delay_reading = DelayReading::kPaper;
  CHECK_THROWS_WITH(Extruder{p}, Catch::Contains("transport"));
  p = make_parameters();
  p.polymer.melt.length_m = 0.1;
  CHECK_THROWS_WITH(Extruder{p}, Catch::Contains("0.1 m long"));
}
