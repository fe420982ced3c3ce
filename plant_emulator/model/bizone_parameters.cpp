#include "plant_emulator/model/bizone_parameters.hpp"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace meltbench::plant {

namespace {

void require(bool holds, std::string_view name, double value, std::string_view range) {
  if (!holds) throw std::invalid_argument(fmt::format("extruder: {} = {}, must be {}", name, value, range));
}

void require_positive(std::string_view name, double value) {
  require(std::isfinite(value) && value > 0.0, name, value, "> 0");
}

struct PresetRow {
  std::string_view name;
  Preset preset;
  double speed_m_per_s;
  double fluctuation_rate_scale;  // Times the omega that [D17] prints.
  DelayReading delay_reading;
};

constexpr std::array kPresets{
    PresetRow{"paper", Preset::kPaper, 0.9, 1.0, DelayReading::kPaper},
    PresetRow{"slow", Preset::kSlow, 0.015, 1.0 / 60.0, DelayReading::kTransport},
    PresetRow{"phys", Preset::kPhys, 0.015, 1.0, DelayReading::kTransport},
    // 90 rpm = 3 pi rad/s, times the pitch of 0.01 m.
    PresetRow{"rad", Preset::kRad, 0.03 * std::numbers::pi, 1.0, DelayReading::kPaper},
};

}  // namespace

void BizoneParameters::check() const {
  require_positive("length_m", length_m);
  require_positive("pitch_m", pitch_m);
  require_positive("density_kg_per_m3", density_kg_per_m3);
  require_positive("pressure_flow_m4", pressure_flow_m4);
  require_positive("nozzle_kg", nozzle_kg);
  require_positive("area_m2", area_m2);
  require_positive("viscosity_Pa_s", viscosity_Pa_s);
  require_positive("speed_m_per_s", speed_m_per_s);
  require(fluctuation >= 0.0 && fluctuation < 1.0, "fluctuation", fluctuation, "in [0, 1)");
  require(std::isfinite(fluctuation_rad_per_s) && fluctuation_rad_per_s >= 0.0, "fluctuation_rad_per_s",
          fluctuation_rad_per_s, ">= 0");
  require(std::isfinite(fluctuation_phase_rad), "fluctuation_phase_rad", fluctuation_phase_rad, "finite");
  require(x0_m >= 0.0 && x0_m <= length_m, "x0_m", x0_m, fmt::format("in [0, length_m = {}]", length_m));
  const double U0 = U_before_start.value_or(outflow_ratio(x0_m));
  require(U0 >= 0.0 && U0 <= kMaxFillRatio, "U_before_start", U0, fmt::format("in [0, {}]", kMaxFillRatio));
}

BizoneParameters make_parameters(Preset preset, FluctuationCase fluctuation) {
  BizoneParameters p;
  for (const PresetRow& row : kPresets) {
    if (row.preset != preset) continue;
    p.speed_m_per_s = row.speed_m_per_s;
    p.delay_reading = row.delay_reading;
    p.fluctuation_rad_per_s = row.fluctuation_rate_scale;
  }
  switch (fluctuation) {
    case FluctuationCase::kNone:
      p.fluctuation = 0.0;
      p.fluctuation_rad_per_s = 0.0;
      break;
    case FluctuationCase::kA:
      p.fluctuation = 0.1;
      p.fluctuation_rad_per_s *= 4.0;
      break;
    case FluctuationCase::kB:
      p.fluctuation = 0.4;
      p.fluctuation_rad_per_s *= 0.8;
      break;
  }
  return p;
}

std::optional<Preset> find_preset(std::string_view name) {
  for (const PresetRow& row : kPresets) {
    if (row.name == name) return row.preset;
  }
  return std::nullopt;
}

std::optional<FluctuationCase> find_fluctuation_case(std::string_view name) {
  if (name == "none") return FluctuationCase::kNone;
  if (name == "A") return FluctuationCase::kA;
  if (name == "B") return FluctuationCase::kB;
  return std::nullopt;
}

}  // namespace meltbench::plant
