#include "controller/law/melt_reference.hpp"

#include <cmath>

namespace meltbench::law {
namespace {

/// Positive and negative root of α q² - b q - h = 0, (12), (13); the negative one without cancellation.
struct Roots {
  double positive_1_per_m;
  double negative_1_per_m;
};

Roots calc_roots(double alpha, double b, double h) {
  const double S = std::sqrt(b * b + 4.0 * alpha * h);
  return {(b + S) / (2.0 * alpha), -2.0 * h / (b + S)};
}

}  // namespace

MeltModel hdpe_melt_model(double barrel_exchange_W_per_m3K) {
  return {.solid = {.conductivity_W_per_mK = 0.373,
                    .density_kg_per_m3 = 955.0,
                    .heat_capacity_J_per_kgK = 1895.0,
                    .barrel_exchange_W_per_m3K = barrel_exchange_W_per_m3K},
          .liquid = {.conductivity_W_per_mK = 0.324,
                     .density_kg_per_m3 = 780.0,
                     .heat_capacity_J_per_kgK = 2640.0,
                     .barrel_exchange_W_per_m3K = barrel_exchange_W_per_m3K},
          .T_melt_degC = 135.0,
          .heat_of_fusion_J_per_kg = 39000.0,
          .length_m = 0.1,
          .nozzle_flux_W_per_m2 = 100.0};
}

double MeltReference::T_degC(double x_m) const noexcept {
  const double d = x_m - front_m;
  const double layer = d <= 0.0 ? p3_K * std::exp(q3_1_per_m * d) : p3_K * std::exp(q4_1_per_m * d);
  return T_barrel_degC + layer + p4_K * std::exp(q4_1_per_m * d);
}

std::optional<MeltReference> calc_melt_reference(const MeltModel& model, double T_barrel_degC, double speed_m_per_s,
                                                 double front_m) noexcept {
  if (!(speed_m_per_s > 0.0 && front_m > 0.0 && front_m < model.length_m)) return std::nullopt;
  const double b = speed_m_per_s;
  const double k_s = model.solid.conductivity_W_per_mK;
  const double k_l = model.liquid.conductivity_W_per_mK;
  const double alpha_s = model.solid.diffusivity_m2_per_s();
  const double alpha_l = model.liquid.diffusivity_m2_per_s();
  const double h_s = model.solid.exchange_rate_1_per_s();
  const double q_m = model.nozzle_flux_W_per_m2;
  const double beta = 1.0 / (model.solid.density_kg_per_m3 * model.heat_of_fusion_J_per_kg);
  const double r = T_barrel_degC - model.T_melt_degC;
  const double l = model.length_m - front_m;
  const auto [q1, q2] = calc_roots(alpha_l, b, model.liquid.exchange_rate_1_per_s());
  const auto [q3, q4] = calc_roots(alpha_s, b, h_s);

  // (14)-(18) divided through by e^{q1 l}, whose exponent exceeds what a double holds.
  const double E21 = std::exp((q2 - q1) * l);
  const double E1 = std::exp(-q1 * l);
  const double D = q1 - q2 * E21;
  const double p1 = (r * q2 * std::exp(q2 * l) + q_m / k_l) / D * E1;
  const double p2 = -(r * q1 + q_m / k_l * E1) / D;
  const double K = (k_l * r * (-q1 * q2) * (1.0 - E21) + (q1 - q2) * q_m * E1) / D;
  const double p3 = (r * q4 + K / k_s) / (q3 - q4);
  const double p4 = -r - p3;
  const double q_f = -k_s * (p3 * q3 * std::exp(-q3 * front_m) + p4 * q4 * std::exp(-q4 * front_m));

  // (64): A, and A - β b C/α_s in closed form, where the two terms cancel to a hundred-thousandth.
  const double liquid_curvature = p1 * q1 * q1 + p2 * q2 * q2;
  const double A_minus = -beta * (h_s * r * k_s / alpha_s + k_l * liquid_curvature);
  const double A = beta * (k_s * (b * K / k_s - h_s * r) / alpha_s - k_l * liquid_curvature);
  const double b_bar = b + beta * K;                                               // (70), C = K
  const double root = std::sqrt(b_bar * b_bar + 4.0 * alpha_s * (A_minus + h_s));  // (71)
  const double d1 = (b_bar + root) / (2.0 * alpha_s);                              // (69)
  const double d2 = -2.0 * (A_minus + h_s) / (b_bar + root);
  const double gamma = b / (2.0 * alpha_s);  // (73)

  MeltReference reference{.front_m = front_m,
                          .speed_m_per_s = b,
                          .T_barrel_degC = T_barrel_degC,
                          .q3_1_per_m = q3,
                          .q4_1_per_m = q4,
                          .p3_K = p3,
                          .p4_K = p4,
                          .inlet_flux_W_per_m2 = q_f,
                          .T_inlet_degC = 0.0,
                          .front_flux_W_per_m2 = K,
                          .A_1_per_s = A,
                          .d1_1_per_m = d1,
                          .d2_1_per_m = d2,
                          .gamma_1_per_m = gamma,
                          .loop_gain_W_per_m2K = gamma * k_s,
                          .diffusivity_m2_per_s = alpha_s,
                          .conductivity_W_per_mK = k_s,
                          .front_speed_per_flux_m3_per_J = beta};
  reference.T_inlet_degC = reference.T_degC(0.0);
  return reference;
}

}  // namespace meltbench::law
