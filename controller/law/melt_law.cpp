#include "controller/law/melt_law.hpp"

#include <algorithm>
#include <cmath>

namespace meltbench::law {
namespace {

constexpr double kNegligibleExponent = 45.0;  // e^-45 = 3e-20: below the rounding of what came before.

/// ∫_0^1 e^{-z t} (1 - t) dt and ∫_0^1 e^{-z t} t dt: weights of the left and right value of a linear piece.
struct PieceWeights {
  double left;
  double right;
};

PieceWeights calc_piece_weights(double z, double exp_minus_z) {
  if (std::abs(z) < 0.03) {  // Series to z^4: the closed form loses digits like 1/z².
    const double right = 1.0 / 2 + z * (-1.0 / 3 + z * (1.0 / 8 + z * (-1.0 / 30 + z / 144)));
    const double both = 1.0 + z * (-1.0 / 2 + z * (1.0 / 6 + z * (-1.0 / 24 + z / 120)));
    return {both - right, right};
  }
  const double right = (1.0 - exp_minus_z * (1.0 + z)) / (z * z);
  const double both = (1.0 - exp_minus_z) / z;
  return {both - right, right};
}

/// ∫_0^s e^{-d x} (T(x) - T_base) dx for the piecewise-linear profile.
double integrate_profile(double d, double T_base, const MeltObservation& seen) {
  const auto& xi = seen.profile_nodes;
  const auto& T = seen.profile_degC;
  const double s = seen.front_m;
  double sum = 0.0;
  double e_left = 1.0;
  for (std::size_t i = 0; i + 1 < xi.size(); ++i) {
    if (d * s * xi[i] > kNegligibleExponent) break;
    const double width = s * (xi[i + 1] - xi[i]);
    const double e_right = std::exp(-d * s * xi[i + 1]);
    const auto [left, right] = calc_piece_weights(d * width, e_right / e_left);
    sum += e_left * width * (left * (T[i] - T_base) + right * (T[i + 1] - T_base));
    e_left = e_right;
  }
  return sum;
}

/// ∫_from^to e^{-d x} e^{q (x - s_r)} dx.
double integrate_exponential(double d, double q, double s_r, double from, double to) {
  const double rate = q - d;
  const double at_from = std::exp(q * (from - s_r) - d * from);
  if (std::abs(rate * (to - from)) < 1.0) {
    if (rate == 0.0) return at_from * (to - from);
    return at_from * std::expm1(rate * (to - from)) / rate;
  }
  return (std::exp(q * (to - s_r) - d * to) - at_from) / rate;
}

/// ∫_0^s e^{-d x} (T_s,eq(x) - T_b) dx, with the continuation beyond s_r.
double integrate_reference(double d, const MeltReference& reference, double s) {
  const double s_r = reference.front_m;
  const double inside = std::min(s, s_r);
  double sum = reference.p3_K * integrate_exponential(d, reference.q3_1_per_m, s_r, 0.0, inside) +
               reference.p4_K * integrate_exponential(d, reference.q4_1_per_m, s_r, 0.0, inside);
  if (s > s_r) sum += (reference.p3_K + reference.p4_K) * integrate_exponential(d, reference.q4_1_per_m, s_r, s_r, s);
  return sum;
}

}  // namespace

double calc_melt_gain_W_per_m3(const MeltReference& reference, double c_1_per_s, double x_m) noexcept {
  const auto d1 = reference.d1_1_per_m, d2 = reference.d2_1_per_m, gamma = reference.gamma_1_per_m;
  return c_1_per_s / (reference.front_speed_per_flux_m3_per_J * (d1 - d2)) *
         ((d1 - gamma) * std::exp(-d1 * x_m) - (d2 - gamma) * std::exp(-d2 * x_m));  // (75)
}

double calc_melt_Z_W_per_m2(const MeltReference& reference, double c_1_per_s,
                            const MeltObservation& observation) noexcept {
  const auto d1 = reference.d1_1_per_m, d2 = reference.d2_1_per_m, gamma = reference.gamma_1_per_m;
  const double s = observation.front_m;
  const double T_b = reference.T_barrel_degC;
  const auto error = [&](double d) {
    return integrate_profile(d, T_b, observation) - integrate_reference(d, reference, s);
  };
  // β cancels between (75) and (88), and k_s/α_s = ρ_s c_s.
  const double heat_capacity_J_per_m3K = reference.conductivity_W_per_mK / reference.diffusivity_m2_per_s;
  const double integral =
      heat_capacity_J_per_m3K * c_1_per_s / (d1 - d2) * ((d1 - gamma) * error(d1) - (d2 - gamma) * error(d2));
  return integral - calc_melt_gain_W_per_m3(reference, c_1_per_s, s) * (s - reference.front_m);  // (88)
}

MeltCommand limit_melt_gain(const MeltCommand& command, const MeltReference& reference, double sample_time_s) noexcept {
  const double largest = 0.5 * reference.conductivity_W_per_mK / (reference.speed_m_per_s * sample_time_s);
  MeltCommand limited = command;
  limited.gain_W_per_m2K = std::min(command.gain_W_per_m2K, largest);
  return limited;
}

MeltCommand OpenLoopMeltLaw::update(const MeltReference& reference, const MeltObservation&, double) noexcept {
  return {reference.inlet_flux_W_per_m2, 0.0, reference.T_inlet_degC};
}

MeltCommand PiMeltLaw::update(const MeltReference& reference, const MeltObservation& observation,
                              double dt_s) noexcept {
  const double error_m = observation.front_m - reference.front_m;
  integral_m_s_ += error_m * dt_s;
  const double q_f = reference.inlet_flux_W_per_m2 + gains_.proportional_W_per_m3 * error_m +
                     gains_.integral_W_per_m3s * integral_m_s_;  // (133)
  return {q_f, 0.0, reference.T_inlet_degC};
}

MeltCommand BacksteppingMeltLaw::update(const MeltReference& reference, const MeltObservation& observation,
                                        double dt_s) noexcept {
  const double b = reference.speed_m_per_s;
  const double error_m = observation.front_m - reference.front_m;
  if (std::abs(error_m) <= settings_.trim_gate_m) {
    const double limit = settings_.trim_limit_K;
    trim_K_ = std::clamp(trim_K_ + settings_.trim_rate_K_per_m2 * b * error_m * dt_s, -limit, limit);
  }
  const double c = settings_.convergence_per_travel_1_per_m * b;
  const double Z = calc_melt_Z_W_per_m2(reference, c, observation);
  return {reference.inlet_flux_W_per_m2, reference.loop_gain_W_per_m2K,
          reference.T_inlet_degC - Z / reference.loop_gain_W_per_m2K + trim_K_};
}

}  // namespace meltbench::law
