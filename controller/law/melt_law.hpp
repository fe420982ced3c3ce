#pragma once
/// Laws that hold the melting front by the heat flux at the inlet: open loop, PI, backstepping. Numbers in, numbers
/// out.

#include <memory>
#include <span>

#include "controller/law/melt_reference.hpp"

namespace meltbench::law {

/// What a law sees. The profile is That (output feedback) or T (full state) on nodes ξ of [0, 1], x = s ξ.
struct MeltObservation {
  double front_m;                         ///< Y1 = s.
  double T_inlet_degC;                    ///< Y2 = T_s(0).
  std::span<const double> profile_nodes;  ///< ξ, rising from 0 to 1.
  std::span<const double> profile_degC;   ///< Temperatures there; linear between nodes.
};

/// What a law asks of the inlet preconditioner: q_f = feedforward - gain (T_s(0) - T_reference). The board closes this
/// loop at its own rate; where it cannot, calc_flux_W_per_m2() with a sampled inlet temperature is the digital
/// stand-in.
struct MeltCommand {
  double feedforward_W_per_m2;
  double gain_W_per_m2K;  ///< Zero: plain flux.
  double T_reference_degC;

  [[nodiscard]] constexpr double calc_flux_W_per_m2(double T_inlet_degC) const {
    return feedforward_W_per_m2 - gain_W_per_m2K * (T_inlet_degC - T_reference_degC);
  }
};

/// f(x), (K5), [K19] (75) [W/m³], x >= 0: heat flux per metre of front; c is the convergence rate [1/s].
///   f(x) = c/(β (d1 - d2)) ((d1 - γ) e^{-d1 x} - (d2 - γ) e^{-d2 x})
[[nodiscard]] double calc_melt_gain_W_per_m3(const MeltReference& reference, double c_1_per_s, double x_m) noexcept;

/// Z, (K6), [K19] (88): the part of the law that looks at the whole profile and the front [W/m²]:
///   Z = β k_s/α_s ∫_0^s f(x) (That - T_s,eq) dx - f(s) (s - s_r)
/// Both exponentials of f are integrated exactly, against the piecewise-linear profile and the exponentials of T_s,eq:
/// the first one decays within α/b, where a trapezoid rule would misjudge it by any factor.
/// Cost: one exponential per node; no allocation.
[[nodiscard]] double calc_melt_Z_W_per_m2(const MeltReference& reference, double c_1_per_s,
                                          const MeltObservation& observation) noexcept;

/// (K8): largest gain that a law sampled every Ts may close itself: the inlet integrates q_f with b/k_s, and half of it
/// per sample still settles without overshoot. Returns the command with its gain limited; T_reference stays.
[[nodiscard]] MeltCommand limit_melt_gain(const MeltCommand& command, const MeltReference& reference,
                                          double sample_time_s) noexcept;

/// A law by name; the controller swaps them.
class MeltLaw {
 public:
  virtual ~MeltLaw() = default;
  /// One sample: dt since the last one. No allocation, no throw.
  virtual MeltCommand update(const MeltReference& reference, const MeltObservation& observation,
                             double dt_s) noexcept = 0;
  virtual void reset() noexcept = 0;
};

/// (K9), q_f = q_f*: what (9) suffices for if nothing disturbs.
class OpenLoopMeltLaw final : public MeltLaw {
 public:
  MeltCommand update(const MeltReference& reference, const MeltObservation& observation, double dt_s) noexcept override;
  void reset() noexcept override {}
};

/// (K10), [K19] (133): q_f = q_f* + K_P (s - s_r) + K_I ∫ (s - s_r) dt. Kept to show what it does: the inlet integrates
/// q_f and the front integrates the inlet behind a delay s/b, so it either creeps or loses the front.
class PiMeltLaw final : public MeltLaw {
 public:
  struct Gains {
    double proportional_W_per_m3;  ///< K_P, per metre of front.
    double integral_W_per_m3s;     ///< K_I.
  };
  explicit PiMeltLaw(const Gains& gains) : gains_{gains} {}
  MeltCommand update(const MeltReference& reference, const MeltObservation& observation, double dt_s) noexcept override;
  void reset() noexcept override { integral_m_s_ = 0.0; }

 private:
  Gains gains_;
  double integral_m_s_ = 0.0;
};

/// (K7), [K19] (72) with the true profile, (82) with the observer's: backstepping, as an inlet temperature reference
///   T_reference = T_s,eq(0) - Z/(γ k_s),   gain = γ k_s,   feedforward = q_f*.
class BacksteppingMeltLaw final : public MeltLaw {
 public:
  struct Settings {
    /// c/b [1/m]: the front error falls by e over 1/this of screw travel. [K19] takes 100 at every speed.
    double convergence_per_travel_1_per_m = 100.0;
    /// (K11): slow offset-free trim, ours, off at 0: d(T_reference)/dt = rate b (s - s_r), while |s - s_r| <= gate.
    /// 6000 takes away two thirds of an offset per 0.15 m of travel.
    double trim_rate_K_per_m2 = 0.0;
    double trim_gate_m = 2e-3;
    double trim_limit_K = 5.0;
  };
  BacksteppingMeltLaw() = default;
  explicit BacksteppingMeltLaw(const Settings& settings) : settings_{settings} {}
  MeltCommand update(const MeltReference& reference, const MeltObservation& observation, double dt_s) noexcept override;
  void reset() noexcept override { trim_K_ = 0.0; }
  [[nodiscard]] double trim_K() const noexcept { return trim_K_; }

 private:
  Settings settings_;
  double trim_K_ = 0.0;
};

}  // namespace meltbench::law
