#include "controller/law/melt_law.hpp"

#include <algorithm>
#include <catch2/catch.hpp>
#include <cmath>
#include <vector>

namespace meltbench::law {
namespace {

MeltReference make_reference(double hbar, double b) {
  return calc_melt_reference(hdpe_melt_model(hbar), 145.0, b, 50e-3).value();
}

/// Nodes that are dense at both ends, as an observer's are.
std::vector<double> make_nodes(int cells) {
  std::vector<double> nodes;
  for (int i = 0; i <= cells; ++i) {
    const double t = static_cast<double>(i) / cells;
    nodes.push_back(t < 0.5 ? 0.5 * std::pow(2.0 * t, 6.0) : 1.0 - 0.5 * std::pow(2.0 * (1.0 - t), 6.0));
  }
  return nodes;
}

/// ∫_from^to g by Gauss-Legendre with five points in cells that double in width from `first`: resolves the layer 1/d1.
template <typename Function>
double integrate(double from, double to, double first, Function g) {
  constexpr double x[] = {0.0, 0.5384693101056831, 0.9061798459386640};
  constexpr double w[] = {0.5688888888888889, 0.4786286704993665, 0.2369268850561891};
  double sum = 0.0;
  double left = from, width = first;
  while (left < to) {
    const double right = std::min(to, left + width), middle = 0.5 * (left + right), half = 0.5 * (right - left);
    sum += half * (w[0] * g(middle) + w[1] * (g(middle - half * x[1]) + g(middle + half * x[1])) +
                   w[2] * (g(middle - half * x[2]) + g(middle + half * x[2])));
    left = right;
    width *= 1.02;
  }
  return sum;
}

TEST_CASE("Melt gain: f is c/β at the inlet and half of it beyond the thermal layer", "[law][melt]") {
  for (const double b : {2e-3, 10e-3, 50e-3}) {
    CAPTURE(b);
    const auto reference = make_reference(2e4, b);
    const double c = 100.0 * b, beta = reference.front_speed_per_flux_m3_per_J;
    CHECK(calc_melt_gain_W_per_m3(reference, c, 0.0) == Approx(c / beta).epsilon(1e-12));
    const double far = 30.0 / reference.d1_1_per_m;
    CHECK(calc_melt_gain_W_per_m3(reference, c, far) ==
          Approx(0.5 * c / beta * std::exp(-reference.d2_1_per_m * far)).epsilon(1e-3));
  }
}

TEST_CASE("Melt law: Z integrates both exponentials exactly, on coarse nodes and fine", "[law][melt]") {
  for (const double hbar : {2e4, 9e4}) {
    for (const double b : {2e-3, 10e-3, 50e-3}) {
      for (const double s : {20e-3, 49.9e-3, 51e-3}) {
        for (const int cells : {20, 100}) {
          CAPTURE(hbar, b, s, cells);
          const auto reference = make_reference(hbar, b);
          const double c = 100.0 * b;
          const auto nodes = make_nodes(cells);
          std::vector<double> T;
          for (const double xi : nodes) T.push_back(135.0 - 30.0 * (1.0 - xi) * (1.0 - xi) + 2.0 * std::sin(9.0 * xi));
          // Piece by piece, so that the quadrature never crosses a kink.
          double integral = 0.0;
          const double layer = 0.02 / reference.d1_1_per_m;
          for (std::size_t i = 0; i + 1 < nodes.size(); ++i) {
            const double x0 = s * nodes[i], x1 = s * nodes[i + 1];
            const auto error = [&](double x) {
              const double That = T[i] + (x - x0) / (x1 - x0) * (T[i + 1] - T[i]);
              return calc_melt_gain_W_per_m3(reference, c, x) * (That - reference.T_degC(x));
            };
            const double kink = std::clamp(50e-3, x0, x1);
            integral += integrate(x0, kink, layer, error) + integrate(kink, x1, layer, error);
          }
          const double expected = reference.front_speed_per_flux_m3_per_J * reference.conductivity_W_per_mK /
                                      reference.diffusivity_m2_per_s * integral -
                                  calc_melt_gain_W_per_m3(reference, c, s) * (s - reference.front_m);
          const double Z = calc_melt_Z_W_per_m2(reference, c, {s, T[0], nodes, T});
          CHECK(Z == Approx(expected).epsilon(1e-9).margin(1e-9 * c / reference.front_speed_per_flux_m3_per_J));
        }
      }
    }
  }
}

TEST_CASE("Melt law: at the reference it asks for the steady flux and the steady inlet temperature", "[law][melt]") {
  for (const double hbar : {2e4, 9e4}) {
    for (const double b : {2e-3, 10e-3, 50e-3}) {
      CAPTURE(hbar, b);
      const auto reference = make_reference(hbar, b);
      const auto nodes = make_nodes(200);
      std::vector<double> T;
      for (const double xi : nodes) T.push_back(reference.T_degC(50e-3 * xi));
      BacksteppingMeltLaw law;
      const auto command = law.update(reference, {50e-3, T[0], nodes, T}, 10e-3);
      // What is left is the linear interpolation of the profile between 200 nodes.
      CHECK(command.T_reference_degC == Approx(reference.T_inlet_degC).margin(0.02));
      CHECK(command.calc_flux_W_per_m2(command.T_reference_degC) == reference.inlet_flux_W_per_m2);
    }
  }
}

TEST_CASE("Melt law: an overshoot of the front by 1 mm asks for a finite flux", "[law][melt]") {
  for (const double b : {2e-3, 10e-3, 50e-3}) {
    CAPTURE(b);
    const auto reference = make_reference(2e4, b);
    const auto nodes = make_nodes(100);
    std::vector<double> T;
    for (const double xi : nodes) T.push_back(std::min(135.0, reference.T_degC(51e-3 * xi)));
    BacksteppingMeltLaw law;
    const auto command = law.update(reference, {51e-3, reference.T_inlet_degC, nodes, T}, 10e-3);
    CHECK(std::abs(command.calc_flux_W_per_m2(reference.T_inlet_degC)) < 1e6);
    CHECK(command.T_reference_degC > reference.T_inlet_degC);  // Too far downstream: warm the inlet.
  }
}

TEST_CASE("Melt law: a front 1 mm short of its set point lowers the inlet reference by 2.06 K at every speed",
          "[law][melt]") {
  for (const double b : {2e-3, 10e-3, 50e-3}) {
    CAPTURE(b);
    const auto reference = make_reference(2e4, b);
    const auto nodes = make_nodes(400);
    const double s = 49e-3;
    std::vector<double> T;
    for (const double xi : nodes) T.push_back(reference.T_degC(s * xi));
    BacksteppingMeltLaw law;
    const auto command = law.update(reference, {s, T[0], nodes, T}, 10e-3);
    // c/b (ΔH/c_s) |s - s_r|, times e^{-d2 s} between 1 and 1.15.
    const double expected = 100.0 * 39000.0 / 1895.0 * 1e-3 * std::exp(-reference.d2_1_per_m * s);
    CHECK(reference.T_inlet_degC - command.T_reference_degC == Approx(expected).epsilon(0.01));
  }
}

TEST_CASE("Melt law: the capped gain moves the inlet half way per sample", "[law][melt]") {
  const auto reference = make_reference(2e4, 10e-3);
  const MeltCommand command{0.0, reference.loop_gain_W_per_m2K, 100.0};
  const double Ts = 10e-3;
  const auto limited = limit_melt_gain(command, reference, Ts);
  // dT_0/dt = b q_f/k_s: one sample of the limited law from 1 K off changes the inlet by 0.5 K.
  const double dT = reference.speed_m_per_s / reference.conductivity_W_per_mK * limited.calc_flux_W_per_m2(101.0) * Ts;
  CHECK(dT == Approx(-0.5));
  CHECK(limited.T_reference_degC == 100.0);
  CHECK(limit_melt_gain(command, reference, 1e-6).gain_W_per_m2K == command.gain_W_per_m2K);
}

TEST_CASE("Melt law: open loop and PI give a plain flux", "[law][melt]") {
  const auto reference = make_reference(2e4, 2e-3);
  const MeltObservation seen{40e-3, 130.0, {}, {}};
  OpenLoopMeltLaw open_loop;
  CHECK(open_loop.update(reference, seen, 0.1).calc_flux_W_per_m2(20.0) == reference.inlet_flux_W_per_m2);
  PiMeltLaw pi{{.proportional_W_per_m3 = 300.0, .integral_W_per_m3s = 4.5}};
  pi.update(reference, seen, 1.0);
  const auto command = pi.update(reference, seen, 1.0);
  // (133): -10 mm of error, held for 2 s.
  CHECK(command.calc_flux_W_per_m2(20.0) == Approx(reference.inlet_flux_W_per_m2 - 3.0 - 4.5 * 0.02));
  pi.reset();
  CHECK(pi.update(reference, {50e-3, 130.0, {}, {}}, 1.0).feedforward_W_per_m2 == reference.inlet_flux_W_per_m2);
}

TEST_CASE("Melt law: the trim is off unless asked for, slow, gated and limited", "[law][melt]") {
  const auto reference = make_reference(2e4, 10e-3);
  const auto nodes = make_nodes(20);
  const std::vector<double> T(nodes.size(), 134.0);
  BacksteppingMeltLaw plain;
  plain.update(reference, {51e-3, 134.0, nodes, T}, 10.0);
  CHECK(plain.trim_K() == 0.0);
  BacksteppingMeltLaw trimmed{{.trim_rate_K_per_m2 = 6000.0, .trim_gate_m = 2e-3, .trim_limit_K = 1.0}};
  trimmed.update(reference, {51e-3, 134.0, nodes, T}, 1.0);
  CHECK(trimmed.trim_K() == Approx(6000.0 * 10e-3 * 1e-3 * 1.0));
  trimmed.update(reference, {53e-3, 134.0, nodes, T}, 1.0);
  CHECK(trimmed.trim_K() == Approx(0.06));
  trimmed.update(reference, {51e-3, 134.0, nodes, T}, 1e3);
  CHECK(trimmed.trim_K() == 1.0);
}

}  // namespace
}  // namespace meltbench::law
