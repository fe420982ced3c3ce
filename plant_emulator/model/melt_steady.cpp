#include "plant_emulator/model/melt_steady.hpp"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

namespace meltbench::plant {
namespace {

/// Roots of α q² - b q - h = 0, (12) and (13); the negative one without its cancellation.
struct Roots {
  double positive_1_per_m;
  double negative_1_per_m;
};

Roots calc_roots(const MeltPhase& phase, double b) {
  const double alpha = phase.diffusivity_m2_per_s();
  const double h = phase.exchange_rate_1_per_s();
  const double S = std::sqrt(b * b + 4.0 * alpha * h);
  return {(b + S) / (2.0 * alpha), -2.0 * h / (b + S)};
}

void require_valid(const MeltParameters& parameters, double b, double s_r) {
  if (!(b > 0.0)) throw std::invalid_argument(fmt::format("melt steady state: speed = {} m/s, must be > 0", b));
  if (!(s_r > 0.0 && s_r < parameters.length_m)) {
    throw std::invalid_argument(
        fmt::format("melt steady state: front = {} m, must be in (0, {})", s_r, parameters.length_m));
  }
}

}  // namespace

double MeltSteadyState::T_solid_degC(double x_m) const noexcept {
  const double d = x_m - front_m;
  return T_barrel_degC + p3_K * std::exp(q3_1_per_m * d) + p4_K * std::exp(q4_1_per_m * d);  // (11)
}

double MeltSteadyState::T_liquid_degC(double x_m) const noexcept {
  return T_barrel_degC + P1L_K * std::exp(q1_1_per_m * (x_m - length_m)) +
         p2_K * std::exp(q2_1_per_m * (x_m - front_m));  // (11)
}

MeltSteadyState calc_melt_steady_state(const MeltParameters& parameters, double T_barrel_degC, double speed_m_per_s,
                                       double front_m) {
  require_valid(parameters, speed_m_per_s, front_m);
  const double k_s = parameters.solid.conductivity_W_per_mK;
  const double k_l = parameters.liquid.conductivity_W_per_mK;
  const double q_m = parameters.nozzle_flux_W_per_m2;
  const double r = T_barrel_degC - parameters.T_melt_degC;
  const double l = parameters.length_m - front_m;
  const auto [q1, q2] = calc_roots(parameters.liquid, speed_m_per_s);
  const auto [q3, q4] = calc_roots(parameters.solid, speed_m_per_s);

  // (14)-(18) with numerator and denominator divided by e^{q1 l}: every exponential left is at most one.
  const double E21 = std::exp((q2 - q1) * l);
  const double E1 = std::exp(-q1 * l);
  const double D = q1 - q2 * E21;
  const double P1L = (r * q2 * std::exp(q2 * l) + q_m / k_l) / D;                                     // (14) e^{q1 l}
  const double p2 = -(r * q1 + q_m / k_l * E1) / D;                                                   // (15)
  const double K = (k_l * r * (-q1 * q2) * (1.0 - E21) + (q1 - q2) * q_m * E1) / D;                   // (18)
  const double p3 = (r * q4 + K / k_s) / (q3 - q4);                                                   // (16)
  const double p4 = -r - p3;                                                                          // (17)
  const double q_f = -k_s * (p3 * q3 * std::exp(-q3 * front_m) + p4 * q4 * std::exp(-q4 * front_m));  // (19) times -k_s
  return {.front_m = front_m,
          .T_barrel_degC = T_barrel_degC,
          .length_m = parameters.length_m,
          .q1_1_per_m = q1,
          .q2_1_per_m = q2,
          .q3_1_per_m = q3,
          .q4_1_per_m = q4,
          .P1L_K = P1L,
          .p2_K = p2,
          .p3_K = p3,
          .p4_K = p4,
          .front_flux_W_per_m2 = K,
          .inlet_flux_W_per_m2 = q_f};
}

MeltBarrelWindow calc_melt_barrel_window(const MeltParameters& parameters, double speed_m_per_s, double front_m) {
  require_valid(parameters, speed_m_per_s, front_m);
  const double k_s = parameters.solid.conductivity_W_per_mK;
  const double k_l = parameters.liquid.conductivity_W_per_mK;
  const double q_m = parameters.nozzle_flux_W_per_m2;
  const double l = parameters.length_m - front_m;
  const auto [q1, q2] = calc_roots(parameters.liquid, speed_m_per_s);
  const double q3 = calc_roots(parameters.solid, speed_m_per_s).positive_1_per_m;
  const double E21 = std::exp((q2 - q1) * l);
  const double q_den = -k_l * q1 * q2 * (1.0 - E21) + k_s * q3 * (q1 - q2 * E21);  // (22) e^{-q1 l}
  return {.lower_K = -(q1 - q2) * q_m * std::exp(-q1 * l) / q_den,
          .upper_K = -q_m / (k_l * q2 * std::exp(q2 * l))};  // (21)
}

}  // namespace meltbench::plant
