#pragma once
/// [plant] kind = "melt": the melting extruder of [K19] alone, its barrel at one constant temperature.

#include <functional>
#include <vector>

#include "plant_emulator/model/melt_column.hpp"
#include "plant_emulator/plant.hpp"

namespace meltbench::emulator {

/// Where a melt plant begins.
enum class MeltStart {
  kLinear,  ///< As [K19] section 7: granules linear from T_inlet to T_m, melt linear with the slope q_m/k_l.
  kSteady,  ///< On the steady state that holds the front where it is.
};

struct MeltPlantSettings {
  plant::MeltParameters melt = plant::paper_melt_parameters();
  plant::MeltNumerics numerics;
  double speed_m_per_s = 0.002;  ///< b: until a screw drive says otherwise.
  double pitch_m = 0.01;         ///< Conveyed per turn of the screw.
  double T_barrel_degC = 145;
  MeltStart start = MeltStart::kLinear;
  double start_front_m = 0.02;
  double start_T_inlet_degC = 115;
};

/// Signals of a melt column: front, margins, energy account, and the temperature at kProfilePoints equidistant places
/// from inlet to nozzle ("melt.T_00_degC" ...).
inline constexpr std::size_t kProfilePoints = 41;
[[nodiscard]] std::span<const SignalInfo> melt_signals();
/// @param front_m, flux  as of the instant of the recording.
void read_melt_signals(const plant::MeltFront& melt, double length_m, double front_m, double flux_W_per_m2,
                       std::span<double> values);
/// Without a melt front to speak of: the temperatures alone, and what has no meaning is not a number.
/// @param T_at  temperature at x.
void read_standing_signals(const std::function<double(double x_m)>& T_at, double length_m, double front_m,
                           std::span<double> values);

/// Tells once when the equations stop describing the extruder.
class MeltStatusReport {
 public:
  void tell(plant::MeltStatus status, Instant now, Outbox& out);

 private:
  plant::MeltStatus told_ = plant::MeltStatus::kRunning;
};

/// The melting extruder as the boards see it.
class MeltPlant final : public Plant {
 public:
  /// @throws std::invalid_argument as MeltFront and calc_melt_steady_state().
  explicit MeltPlant(const MeltPlantSettings& settings);

  void advance_to(Instant to) override;
  void settle(Instant now) override;
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override;
  void report(Instant now, Outbox& out) override { status_.tell(column_.melt().status(), now, out); }

  [[nodiscard]] double pressure_Pa() const override { return 0; }
  [[nodiscard]] double encoder_rev() const override { return conveyed_m_ / settings_.pitch_m; }
  [[nodiscard]] double encoder_rev_per_s() const override { return speed_m_per_s_ / settings_.pitch_m; }
  void set_feed_kg_per_s(double /*feed_kg_per_s*/) override {}
  void set_screw_rev_per_s(double screw_rev_per_s) override;
  [[nodiscard]] double front_m() override;
  [[nodiscard]] double T_inlet_degC() override;
  [[nodiscard]] double T_melt_degC() override { return column_.melt().T_nozzle_degC(); }
  void set_inlet(const plant::MeltInlet& inlet) override;
  [[nodiscard]] plant::InletFlux inlet_flux() const override { return column_.flux(now_); }

 private:
  void catch_up() { column_.catch_up(now_, conveyed_m_, barrel_); }

  MeltPlantSettings settings_;
  plant::MeltColumn column_;
  plant::MeltBarrel barrel_;
  std::vector<SignalInfo> signals_;
  MeltStatusReport status_;
  Instant now_{};
  double speed_m_per_s_;
  double conveyed_m_ = 0;
};

}  // namespace meltbench::emulator
