/// Closed loops of the delay extruder against published-equation figures and an independent integrator.

#include "tests/controller/law/delay_loop.hpp"

#include <fmt/format.h>

#include <array>
#include <catch2/catch.hpp>
#include <fstream>
#include <map>
#include <sstream>

#include "tests/controller/law/brute_force_loop.hpp"

using namespace meltbench;
using delay_loop::Kind;
using delay_loop::Options;
using plant::DelayReading;
using plant::FluctuationCase;
using plant::Preset;

namespace {

plant::BizoneParameters make(Preset preset, FluctuationCase fluctuation, DelayReading reading) {
  plant::BizoneParameters p = plant::make_parameters(preset, fluctuation);
  p.delay_reading = reading;
  return p;
}

Options sampled(Kind kind, double sample_s, double end_s) {
  Options o;
  o.kind = kind;
  o.sample_s = sample_s;
  o.end_s = end_s;
  return o;
}

constexpr double kSet_m = 0.16;

/// One row of fixtures/reference/delay_zoh_10ms.csv: names, not enumerators, so that others can read it.
struct ReferenceKey {
  std::string preset, fluctuation, reading, law;
  auto operator<=>(const ReferenceKey&) const = default;
};

struct ReferenceCase {
  ReferenceKey key;
  Kind kind;
  std::vector<double> times_s;
};

std::vector<ReferenceCase> reference_cases() {
  const std::vector<double> quick{0.1, 0.12, 0.15, 0.2, 0.25, 0.3, 0.4, 0.6};
  const std::vector<double> slow{5, 7, 8, 9, 10, 12, 15, 20};
  std::vector<ReferenceCase> cases;
  for (const char* fluctuation : {"A", "B"}) {
    cases.push_back({{"paper", fluctuation, "paper", "open_loop"}, Kind::kOpenLoop, quick});
    cases.push_back({{"paper", fluctuation, "paper", "uncompensated"}, Kind::kUncompensated, quick});
    cases.push_back({{"paper", fluctuation, "paper", "paper_predictor"}, Kind::kPaper, quick});
    cases.push_back({{"paper", fluctuation, "paper", "state_only_predictor"}, Kind::kStateOnly, quick});
    cases.push_back({{"paper", fluctuation, "transport", "uncompensated"}, Kind::kUncompensated, quick});
    cases.push_back({{"paper", fluctuation, "transport", "exact_predictor"}, Kind::kExact, quick});
    cases.push_back({{"slow", fluctuation, "transport", "open_loop"}, Kind::kOpenLoop, slow});
    cases.push_back({{"slow", fluctuation, "transport", "uncompensated"}, Kind::kUncompensated, slow});
    cases.push_back({{"slow", fluctuation, "transport", "exact_predictor"}, Kind::kExact, slow});
    cases.push_back({{"slow", fluctuation, "transport", "state_only_predictor"}, Kind::kStateOnly, slow});
    cases.push_back({{"slow", fluctuation, "paper", "paper_predictor"}, Kind::kPaper, slow});
    cases.push_back({{"phys", fluctuation, "transport", "exact_predictor"}, Kind::kExact, slow});
    cases.push_back({{"phys", fluctuation, "transport", "state_only_predictor"}, Kind::kStateOnly, slow});
  }
  return cases;
}

plant::BizoneParameters parameters_of(const ReferenceKey& key) {
  return make(*plant::find_preset(key.preset), *plant::find_fluctuation_case(key.fluctuation),
              key.reading == "paper" ? DelayReading::kPaper : DelayReading::kTransport);
}

const std::string kReferenceFile = MELTBENCH_SOURCE_DIR "/fixtures/reference/delay_zoh_10ms.csv";

std::map<ReferenceKey, std::map<double, double>> read_reference() {
  std::ifstream in{kReferenceFile};
  if (!in) throw std::runtime_error("cannot open " + kReferenceFile);
  std::map<ReferenceKey, std::map<double, double>> table;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line.front() == '#' || line.starts_with("preset")) continue;
    std::istringstream cells{line};
    std::array<std::string, 6> cell;
    for (std::string& text : cell) std::getline(cells, text, ',');
    table[{cell[0], cell[1], cell[2], cell[3]}][std::stod(cell[4])] = std::stod(cell[5]);
  }
  return table;
}

/// Quantities of a continuous-time loop, from two sampled ones: the error of holding U is of first order in the sample.
template <typename Measure>
double calc_limit(const plant::BizoneParameters& p, Options options, Measure measure) {
  const double coarse = measure(delay_loop::run(p, options));
  options.sample_s *= 0.5;
  return 2.0 * measure(delay_loop::run(p, options)) - coarse;
}

}  // namespace

TEST_CASE("Make fixtures/reference/delay_zoh_10ms.csv anew (hidden)", "[.reference]") {
  std::ofstream out{kReferenceFile};
  out << "# Filled length of the delay extruder under sampled laws: x at t, x0 = 0.1 m, x* = 0.16 m, vmax = 0.9, dS = "
         "30 /m.\n"
         "# The law sees x and commands at t = 0, 10 ms, ...; U is held in between; no latency; before t = 0 U = "
         "v(x0).\n"
         "# Made by tests/controller/law/brute_force_loop.hpp (law_tests \"[.reference]\"): the delay ODE in time, RK4 "
         "with\n"
         "# located jumps, predictions by running a copy of the plant ahead. Shares no formula with plant or "
         "predictors.\n"
         "preset,fluctuation,delay,law,t_s,x_m\n";
  for (const ReferenceCase& one : reference_cases()) {
    const delay_loop::Run run = brute_force::run(parameters_of(one.key), one.kind, 0.01, one.times_s.back());
    for (const double t : one.times_s) {
      out << fmt::format("{},{},{},{},{},{:.12f}\n", one.key.preset, one.key.fluctuation, one.key.reading, one.key.law,
                         t, run.x_at(t));
    }
  }
}

TEST_CASE("Delay loop: cases A and B, sampled at 10 ms, equal the brute-force reference in every law", "[law]") {
  const auto reference = read_reference();
  for (const ReferenceCase& one : reference_cases()) {
    INFO(fmt::format("{} {} {} {}", one.key.preset, one.key.fluctuation, one.key.reading, one.key.law));
    const delay_loop::Run run = delay_loop::run(parameters_of(one.key), sampled(one.kind, 0.01, one.times_s.back()));
    CHECK_FALSE(run.infeasible);
    for (const double t : one.times_s) {
      CHECK(run.x_at(t) == Approx(reference.at(one.key).at(t)).margin(1e-8).epsilon(0));
    }
  }
}

TEST_CASE("Delay loop: the stored reference is what the brute-force integrator gives", "[law]") {
  const auto reference = read_reference();
  for (const ReferenceCase& one : reference_cases()) {
    if (one.key.preset != "paper") continue;  // The others take seconds each in a debug build.
    INFO(fmt::format("{} {} {} {}", one.key.preset, one.key.fluctuation, one.key.reading, one.key.law));
    const delay_loop::Run run = brute_force::run(parameters_of(one.key), one.kind, 0.01, 0.2);
    CHECK(run.x_at(0.2) == Approx(reference.at(one.key).at(0.2)).margin(1e-11).epsilon(0));
  }
}

TEST_CASE("Delay loop: 10 ms samples give the printed figures", "[law]") {
  // Printed with 12 digits by other integrators than ours; holding U for 10 ms is part of the definition.
  const auto x = [](Preset preset, DelayReading reading, Kind kind, double t) {
    return delay_loop::run(make(preset, FluctuationCase::kA, reading), sampled(kind, 0.01, t)).x_at(t);
  };
  const auto near = [](double value) { return Approx(value).margin(1e-9).epsilon(0); };
  const auto transport = DelayReading::kTransport, paper = DelayReading::kPaper;
  CHECK(x(Preset::kPaper, transport, Kind::kExact, 0.12) == near(0.149174858448));
  CHECK(x(Preset::kPaper, transport, Kind::kExact, 0.15) == near(0.158688523952));
  CHECK(x(Preset::kPaper, transport, Kind::kExact, 0.2) == near(0.159952979065));
  CHECK(x(Preset::kSlow, transport, Kind::kExact, 7) == near(0.143430195590));
  CHECK(x(Preset::kSlow, transport, Kind::kExact, 9) == near(0.157541920964));
  CHECK(x(Preset::kSlow, transport, Kind::kExact, 12) == near(0.159795794162));
  CHECK(x(Preset::kPhys, transport, Kind::kExact, 10) == near(0.157853414830));
  CHECK(x(Preset::kSlow, transport, Kind::kUncompensated, 10) == near(0.178951800200));
  CHECK(x(Preset::kPaper, transport, Kind::kUncompensated, 0.2) == near(0.174951604602));
  CHECK(x(Preset::kPaper, paper, Kind::kPaper, 0.12) == near(0.148683370218));
  CHECK(x(Preset::kPaper, paper, Kind::kPaper, 0.15) == near(0.158637933878));
  CHECK(x(Preset::kSlow, paper, Kind::kPaper, 12) == near(0.159790585173));
}

TEST_CASE("Delay loop: the open loop settles when the printed figures say", "[law]") {
  const auto paper = make(Preset::kPaper, FluctuationCase::kA, DelayReading::kPaper);
  const delay_loop::Run run = delay_loop::run(paper, sampled(Kind::kOpenLoop, 0.001, 6.0));
  // U is constant from 0 on, so nothing is lost by sampling; the crossing is interpolated within 1 ms.
  CHECK(run.settling_s(kSet_m, 0.02) == Approx(2.088108).margin(1e-6).epsilon(0));
  CHECK(run.settling_s(kSet_m, 0.001) == Approx(4.237244).margin(1e-6).epsilon(0));
  CHECK(run.overshoot_m(kSet_m) == 0.0);

  const auto slow = make(Preset::kSlow, FluctuationCase::kA, DelayReading::kTransport);
  const delay_loop::Run slow_run = delay_loop::run(slow, sampled(Kind::kOpenLoop, 0.05, 600.0));
  CHECK(slow_run.settling_s(kSet_m, 0.02) == Approx(125.2516).margin(1e-4).epsilon(0));
  CHECK(slow_run.settling_s(kSet_m, 0.001) == Approx(254.200).margin(1e-3).epsilon(0));
  CHECK(slow_run.absolute_error_m_s(kSet_m) == Approx(2.78053).margin(1e-4).epsilon(0));  // Tail beyond 600 s.
}

TEST_CASE("Delay loop: predictors tend to the printed continuous figures as the samples shrink", "[law]") {
  // The error of holding U is proportional to the sample; two samples give the limit with an error of second order:
  // (0.25 ms / 10 ms)^2 of 2.5 mm for `paper`, the same scaled by 60 in time for `slow`.
  struct Figure {
    Preset preset;
    DelayReading reading;
    Kind kind;
    double sample_s, end_s, t2_s, t01_s, overshoot_m, absolute_error_m_s;
  };
  const auto [preset, reading, kind, sample_s, end_s, t2_s, t01_s, overshoot_m, error_m_s] = GENERATE(values<Figure>({
      {Preset::kPaper, DelayReading::kPaper, Kind::kPaper, 5e-4, 0.6, .145594489, .205914260, 0.0, .00689407},
      {Preset::kPaper, DelayReading::kPaper, Kind::kStateOnly, 1e-4, 0.6, .131744, .209381, .422e-3, .00675707},
      {Preset::kSlow, DelayReading::kTransport, Kind::kExact, 0.03, 36.0, 8.705058, 12.32380, 0.0, .411817},
      {Preset::kPhys, DelayReading::kTransport, Kind::kExact, 0.02, 36.0, 9.5184, 13.4298, 0.0, .451248},
      {Preset::kPhys, DelayReading::kTransport, Kind::kStateOnly, 0.02, 36.0, 9.5187, 13.4243, 0.0, .451250},
  }));
  const auto p = make(preset, FluctuationCase::kA, reading);
  const Options options = sampled(kind, sample_s, end_s);
  const auto limit = [&](auto measure) { return calc_limit(p, options, measure); };
  const double scale_s = p.speed_m_per_s < 0.1 ? 1.0 : 1.0 / 60.0;
  CHECK(limit([](const auto& run) { return run.settling_s(kSet_m, 0.02); }) ==
        Approx(t2_s).margin(2e-3 * scale_s).epsilon(0));
  CHECK(limit([](const auto& run) { return run.settling_s(kSet_m, 0.001); }) ==
        Approx(t01_s).margin(2e-3 * scale_s).epsilon(0));
  CHECK(limit([](const auto& run) { return run.overshoot_m(kSet_m); }) == Approx(overshoot_m).margin(4e-6).epsilon(0));
  CHECK(limit([](const auto& run) { return run.absolute_error_m_s(kSet_m); }) == Approx(error_m_s).epsilon(2e-4));
}

TEST_CASE("Delay loop: predictors pass the printed points of the continuous curves", "[law]") {
  const auto x = [](Preset preset, DelayReading reading, Kind kind, double sample_s, double t) {
    return calc_limit(make(preset, FluctuationCase::kA, reading), sampled(kind, sample_s, t),
                      [t](const auto& run) { return run.x_at(t); });
  };
  // Error of the limit as above, second order: below 5e-6 m.
  const auto near = [](double value) { return Approx(value).margin(5e-6).epsilon(0); };
  CHECK(x(Preset::kPaper, DelayReading::kPaper, Kind::kPaper, 5e-4, 0.15) == near(.15745512));
  CHECK(x(Preset::kPaper, DelayReading::kPaper, Kind::kPaper, 5e-4, 0.2) == near(.15978689));
  CHECK(x(Preset::kPaper, DelayReading::kPaper, Kind::kPaper, 5e-4, 0.3) == near(.15999818));
  CHECK(x(Preset::kPaper, DelayReading::kPaper, Kind::kStateOnly, 5e-4, 0.2) == near(.15968435));
  CHECK(x(Preset::kSlow, DelayReading::kTransport, Kind::kExact, 0.02, 10) == near(.158933233));
  CHECK(x(Preset::kSlow, DelayReading::kTransport, Kind::kExact, 0.02, 20) == near(.159999624));
  CHECK(x(Preset::kPhys, DelayReading::kTransport, Kind::kExact, 0.02, 10) == near(.157836021));
  CHECK(x(Preset::kPhys, DelayReading::kTransport, Kind::kStateOnly, 0.02, 10) == near(.157808813));
}

TEST_CASE("Delay loop: without compensation it never settles and swings by 9 mm", "[law]") {
  const auto paper = make(Preset::kPaper, FluctuationCase::kA, DelayReading::kPaper);
  const auto paper_limit = [&](auto measure) {
    return calc_limit(paper, sampled(Kind::kUncompensated, 2e-4, 6.0), measure);
  };
  CHECK(paper_limit([](const auto& run) { return run.overshoot_m(kSet_m); }) == Approx(30.680e-3).margin(1e-5));
  CHECK(paper_limit([](const auto& run) { return run.peak_to_peak_m(3.0, 6.0); }) == Approx(.00897).margin(2e-5));
  CHECK(paper_limit([](const auto& run) { return run.x_at(1.0); }) == Approx(.1587396).margin(2e-5).epsilon(0));
  CHECK(paper_limit([](const auto& run) { return run.x_at(2.0); }) == Approx(.1580667).margin(2e-5).epsilon(0));

  const auto slow = make(Preset::kSlow, FluctuationCase::kA, DelayReading::kTransport);
  const auto slow_limit = [&](auto measure) {
    return calc_limit(slow, sampled(Kind::kUncompensated, 0.02, 800.0), measure);
  };
  CHECK(slow_limit([](const auto& run) { return run.overshoot_m(kSet_m); }) == Approx(30.6724e-3).margin(2e-6));
  // The limit cycle has died down to its final size after 9 m conveyed.
  CHECK(slow_limit([](const auto& run) { return run.peak_to_peak_m(600.0, 800.0); }) == Approx(.0086756).margin(2e-6));
  CHECK(slow_limit([](const auto& run) { return run.x_at(10.0); }) == Approx(.178884832).margin(5e-6).epsilon(0));
  CHECK(delay_loop::run(slow, sampled(Kind::kUncompensated, 0.01, 100.0)).settling_s(kSet_m, 0.02) > 95.0);
}

TEST_CASE("Delay loop: a matched predictor does not overshoot", "[law]") {
  // More than 1e-6 m would mean that the history or a time base is wrong by a sample.
  for (const FluctuationCase fluctuation : {FluctuationCase::kA, FluctuationCase::kB}) {
    for (const Preset preset : {Preset::kSlow, Preset::kPhys}) {
      const auto p = make(preset, fluctuation, DelayReading::kTransport);
      const delay_loop::Run run = delay_loop::run(p, sampled(Kind::kExact, 0.01, 60.0));
      CHECK(run.overshoot_m(kSet_m) <= 1e-6);
      CHECK(run.samples.back().x == Approx(kSet_m).margin(1e-9).epsilon(0));
    }
    const auto p = make(Preset::kPaper, fluctuation, DelayReading::kPaper);
    CHECK(delay_loop::run(p, sampled(Kind::kPaper, 0.01, 1.0)).overshoot_m(kSet_m) <= 1e-6);
  }
}

TEST_CASE("Delay loop: what was predicted comes true when the feed arrives", "[law]") {
  const auto preset = GENERATE(Preset::kSlow, Preset::kPhys);
  const auto fluctuation = GENERATE(FluctuationCase::kA, FluctuationCase::kB);
  const auto p = make(preset, fluctuation, DelayReading::kTransport);
  const law::BangBang bang_bang{delay_loop::matched_model(p), {}};
  delay_loop::AnyPlant extruder{p};
  delay_loop::AnyPredictor predictor{Kind::kExact, delay_loop::matched_model(p), extruder.clock(),
                                     p.outflow_ratio(p.x0_m)};
  double worst = 0.0;
  for (int k = 0; k < 2000; ++k) {
    const double t = 0.01 * k;
    const double P = predictor.predict(t, extruder.x(), t, 0.0).P_m;
    plant::ParcelPlant ahead = extruder.parcels();
    // The feed of now arrives at s + L - P, (C6); what is fed after it has not arrived by then.
    ahead.advance({1e9, extruder.clock().conveyed_m(t) + p.length_m - P}, 0.1);
    worst = std::max(worst, std::abs(ahead.x_m() - P));
    const double U = bang_bang.calc_U(P);
    extruder.advance(t + 0.01, U);
    predictor.feed(t + 0.01, U);
  }
  CHECK(worst < 1e-9);
}

TEST_CASE("Delay loop: 60 times slower is the same curve, 60 times later", "[law]") {
  const auto kind = GENERATE(Kind::kOpenLoop, Kind::kUncompensated, Kind::kExact, Kind::kStateOnly, Kind::kPaper);
  const auto reading = GENERATE(DelayReading::kTransport, DelayReading::kPaper);
  const auto fluctuation = GENERATE(FluctuationCase::kA, FluctuationCase::kB);
  const delay_loop::Run fast = delay_loop::run(make(Preset::kPaper, fluctuation, reading), sampled(kind, 0.01, 0.6));
  const delay_loop::Run slow = delay_loop::run(make(Preset::kSlow, fluctuation, reading), sampled(kind, 0.6, 36.0));
  REQUIRE(fast.samples.size() == slow.samples.size());
  double worst = 0.0;
  for (std::size_t i = 0; i < fast.samples.size(); ++i) {
    worst = std::max(worst, std::abs(fast.samples[i].x - slow.samples[i].x));
  }
  CHECK(worst < 1e-10);
}

TEST_CASE("Delay loop: over metres conveyed the orbit is one curve for every screw and fluctuation", "[law]") {
  // Sampled at equal steps of s. True for the exact predictor and without compensation, not for the state-only law.
  const auto orbit = [](const plant::BizoneParameters& p, Kind kind) {
    const law::BizoneModel model = delay_loop::matched_model(p);
    const law::BangBang bang_bang{model, {}};
    delay_loop::AnyPlant extruder{p};
    delay_loop::AnyPredictor predictor{kind, model, extruder.clock(), p.outflow_ratio(p.x0_m)};
    std::vector<double> x;
    double t = 0.0;
    for (int k = 1; k <= 1500; ++k) {
      const double P = kind == Kind::kUncompensated ? extruder.x() : predictor.predict(t, extruder.x(), t, 0.0).P_m;
      const double U = bang_bang.calc_U(P);
      const double g = 2e-4 * k / p.speed_m_per_s;
      t = extruder.clock().calc_time_s(extruder.clock().stretched_time_s(0.0) + g, g);
      extruder.advance(t, U);
      predictor.feed(t, U);
      x.push_back(extruder.x());
    }
    return x;
  };
  const auto difference = [](const std::vector<double>& a, const std::vector<double>& b) {
    double worst = 0.0;
    for (std::size_t i = 0; i < a.size(); ++i) worst = std::max(worst, std::abs(a[i] - b[i]));
    return worst;
  };
  const auto base = make(Preset::kSlow, FluctuationCase::kNone, DelayReading::kTransport);
  const auto exact = orbit(base, Kind::kExact), uncompensated = orbit(base, Kind::kUncompensated);
  for (const Preset preset : {Preset::kPaper, Preset::kSlow, Preset::kPhys, Preset::kRad}) {
    for (const FluctuationCase fluctuation : {FluctuationCase::kA, FluctuationCase::kB}) {
      const auto p = make(preset, fluctuation, DelayReading::kTransport);
      CHECK(difference(orbit(p, Kind::kExact), exact) < 1e-10);
      // The limit cycle amplifies the rounding of the clock's inverse.
      CHECK(difference(orbit(p, Kind::kUncompensated), uncompensated) < 1e-9);
    }
  }
  const auto fluctuating = make(Preset::kSlow, FluctuationCase::kB, DelayReading::kTransport);
  CHECK(difference(orbit(fluctuating, Kind::kStateOnly), exact) > 1e-3);
}

TEST_CASE("Delay loop: a gentle slope needs no compensation, so dS = 20 settles without", "[law]") {
  const auto p = make(Preset::kSlow, FluctuationCase::kA, DelayReading::kTransport);
  Options options = sampled(Kind::kUncompensated, 0.01, 820.0);
  options.bang_bang.slope_margin_per_m = 20.0;
  const delay_loop::Run run = delay_loop::run(p, options);
  const double t2 = run.settling_s(kSet_m, 0.02);
  const double conveyed = run.samples.at(static_cast<std::size_t>(t2 / 0.01)).s;
  CHECK(conveyed == Approx(0.305).margin(0.001));  // Printed with 3 digits.
  CHECK(run.peak_to_peak_m(9.0 / 0.015, 12.0 / 0.015) < 1e-9);
}

TEST_CASE("Delay loop: the paper's predictor refuses the real screw with the fluctuation as printed", "[law]") {
  const auto fluctuation = GENERATE(FluctuationCase::kA, FluctuationCase::kB);
  const auto p = make(Preset::kPhys, fluctuation, DelayReading::kTransport);
  CHECK(delay_loop::run(p, sampled(Kind::kPaper, 0.01, 20.0)).infeasible);
  CHECK_FALSE(delay_loop::run(p, sampled(Kind::kExact, 0.01, 20.0)).infeasible);
}

TEST_CASE("Delay loop: a wrong guess of what is in the barrel heals after one delay and costs what is printed",
          "[law]") {
  const auto slow = make(Preset::kSlow, FluctuationCase::kA, DelayReading::kTransport);
  const auto t01 = [&](double assumed) {
    Options options = sampled(Kind::kExact, 0.01, 40.0);
    options.assumed_U_before = assumed;
    return delay_loop::run(slow, options).settling_s(kSet_m, 0.001);
  };
  // Continuous figures; 10 ms of holding costs 0.05 s at most.
  CHECK(t01(-1.0) == Approx(12.31).margin(0.05));
  CHECK(t01(0.9) == Approx(15.69).margin(0.05));
  CHECK(t01(0.0) == Approx(9.66).margin(0.05));
}

TEST_CASE("Delay loop: a late actuator costs an overshoot unless the predictor knows", "[law]") {
  struct Figure {
    FluctuationCase fluctuation;
    double t01_s, aware_t01_s, unaware_t01_s, unaware_overshoot_m;
  };
  const auto [fluctuation, t01_s, aware_t01_s, unaware_t01_s, overshoot_m] = GENERATE(values<Figure>(
      {{FluctuationCase::kA, .181, .192, .356, 3.6e-3}, {FluctuationCase::kB, .136, .146, .347, 5.3e-3}}));
  const auto p = make(Preset::kPaper, fluctuation, DelayReading::kTransport);
  Options options = sampled(Kind::kExact, 0.01, 0.6);
  options.looks = 20;
  CHECK(delay_loop::run(p, options).settling_s(kSet_m, 0.001) == Approx(t01_s).margin(1e-3));
  options.actuation_delay_s = 0.01;  // One frame.
  const delay_loop::Run aware = delay_loop::run(p, options);
  CHECK(aware.overshoot_m(kSet_m) < 1e-6);
  CHECK(aware.settling_s(kSet_m, 0.001) == Approx(aware_t01_s).margin(1e-3));
  options.compensate_actuation = false;
  const delay_loop::Run unaware = delay_loop::run(p, options);
  CHECK(unaware.overshoot_m(kSet_m) == Approx(overshoot_m).margin(5e-5));  // Printed with 2 digits.
  CHECK(unaware.settling_s(kSet_m, 0.001) == Approx(unaware_t01_s).margin(2e-3));
}

TEST_CASE("Delay loop: an old measurement does no harm if it has a time stamp, and overshoots if it has not", "[law]") {
  const auto [fluctuation, overshoot_m] =
      GENERATE(table<FluctuationCase, double>({{FluctuationCase::kA, .45e-3}, {FluctuationCase::kB, .71e-3}}));
  const auto p = make(Preset::kPaper, fluctuation, DelayReading::kTransport);
  Options options = sampled(Kind::kExact, 0.01, 0.6);
  options.looks = 20;
  options.measurement_age_s = 0.002;
  CHECK(delay_loop::run(p, options).overshoot_m(kSet_m) < 1e-6);
  options.time_stamped = false;
  CHECK(delay_loop::run(p, options).overshoot_m(kSet_m) ==
        Approx(overshoot_m).margin(1.5e-5));  // Printed with 2 digits.
}

TEST_CASE("Delay loop: a wrong theta2 leaves a bias, for there is no integral action", "[law]") {
  const auto factor = GENERATE(1.1, 0.9);
  const auto p = make(Preset::kSlow, FluctuationCase::kA, DelayReading::kTransport);
  Options options = sampled(Kind::kExact, 0.01, 300.0);
  options.theta2_factor = factor;
  const double bias = delay_loop::run(p, options).samples.back().x - kSet_m;

  // At rest U = v(x) by the plant, and U = law(P) by the controller, whose model carries x over L - x metres of that U.
  law::BizoneModel model = delay_loop::matched_model(p);
  model.theta2_per_m *= factor;
  const law::BangBang bang_bang{model, {}};
  double low = 0.15, high = 0.17;
  for (int i = 0; i < 100; ++i) {
    const double x = 0.5 * (low + high), U = p.outflow_ratio(x);
    const double r = model.theta2_per_m * (1.0 - U), d = p.length_m - x;
    const double P = U / r + (x - U / r) * std::exp(-r * d);
    (bang_bang.calc_U(P) > U ? low : high) = x;
  }
  CHECK(bias == Approx(low - kSet_m).margin(1e-9));
  CHECK(std::abs(bias) == Approx(1.46e-3).margin(5e-5));  // +1.43 and -1.50 mm are printed.
}

TEST_CASE("Delay loop: a wrong scale of the encoder overshoots but leaves no bias", "[law]") {
  const auto p = make(Preset::kSlow, FluctuationCase::kA, DelayReading::kTransport);
  Options options = sampled(Kind::kExact, 0.01, 60.0);
  options.clock_factor = 0.8;
  const delay_loop::Run run = delay_loop::run(p, options);
  CHECK(run.overshoot_m(kSet_m) == Approx(5.3e-3).margin(1e-4));  // Printed with 2 digits.
  CHECK(run.samples.back().x == Approx(kSet_m).margin(1e-6).epsilon(0));
}

TEST_CASE("Delay loop: the paper's predictor needs the phase of the fluctuation, the exact one does not", "[law]") {
  const auto p = make(Preset::kPaper, FluctuationCase::kA, DelayReading::kPaper);
  Options options = sampled(Kind::kPaper, 0.01, 0.6);
  CHECK(delay_loop::run(p, options).overshoot_m(kSet_m) < 1e-6);
  options.phase_error_s = 0.2;
  CHECK(delay_loop::run(p, options).overshoot_m(kSet_m) == Approx(1.3e-3).margin(5e-5));  // Printed with 2 digits.
  const auto transport = make(Preset::kPaper, FluctuationCase::kA, DelayReading::kTransport);
  options.kind = Kind::kExact;
  CHECK(delay_loop::run(transport, options).overshoot_m(kSet_m) < 1e-6);
}

TEST_CASE("Delay loop: the delay rate on the way is the printed one, and beyond 1 for a real screw read as printed",
          "[law]") {
  // dD/dt by differences over a sample, D from its definition in the reading.
  const auto max_rate = [](const plant::BizoneParameters& p, const Options& options) {
    const delay_loop::Run run = delay_loop::run(p, options);
    const plant::ScrewClock clock = delay_loop::AnyPlant{p}.clock();
    const auto delay = [&](const delay_loop::Sample& at) {
      if (p.delay_reading == DelayReading::kPaper) return (p.length_m - at.x) / clock.speed_m_per_s(at.t);
      const double g = (at.s - (p.length_m - at.x)) / p.speed_m_per_s;
      return at.t - clock.calc_time_s(clock.stretched_time_s(0.0) + g, g);
    };
    double worst = 0.0;
    for (std::size_t i = 1; i < run.samples.size(); ++i) {
      worst = std::max(worst, (delay(run.samples[i]) - delay(run.samples[i - 1])) / run.sample_s);
    }
    return worst;
  };
  const auto paper = make(Preset::kPaper, FluctuationCase::kA, DelayReading::kPaper);
  const auto slow = make(Preset::kSlow, FluctuationCase::kA, DelayReading::kTransport);
  const auto phys = make(Preset::kPhys, FluctuationCase::kA, DelayReading::kTransport);
  const auto printed = [](double value) { return Approx(value).margin(1e-3); };  // Differences over a sample.
  CHECK(max_rate(paper, sampled(Kind::kOpenLoop, 5e-4, 10.0)) == printed(.0181));
  CHECK(max_rate(paper, sampled(Kind::kUncompensated, 5e-4, 2.0)) == printed(.2851));
  CHECK(max_rate(paper, sampled(Kind::kPaper, 5e-4, 2.0)) == printed(.0181));
  CHECK(max_rate(paper, sampled(Kind::kStateOnly, 1e-4, 1.0)) == printed(.0936));
  CHECK(max_rate(slow, sampled(Kind::kOpenLoop, 0.03, 600.0)) == printed(.0179));
  CHECK(max_rate(slow, sampled(Kind::kExact, 0.03, 120.0)) == printed(.0179));
  CHECK(max_rate(phys, sampled(Kind::kExact, 0.01, 60.0)) == printed(.151));
  for (const FluctuationCase fluctuation : {FluctuationCase::kA, FluctuationCase::kB}) {
    const auto printed_screw = make(Preset::kPhys, fluctuation, DelayReading::kPaper);
    CHECK(max_rate(printed_screw, sampled(Kind::kOpenLoop, 0.01, 60.0)) > 2.0);
  }
}
