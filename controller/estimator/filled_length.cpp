#include "controller/estimator/filled_length.hpp"

#include <algorithm>
#include <cmath>

namespace meltbench::estimator {

FilledLength calc_filled_length(const law::BizoneModel& model, double pressure_Pa, double c_m_per_s) {
  FilledLength estimate;
  if (!std::isfinite(pressure_Pa) || !std::isfinite(c_m_per_s)) {
    estimate.status = FilledLengthStatus::kInvalid;
    return estimate;
  }
  if (c_m_per_s < kMinSpeedShare * model.speed_m_per_s) {
    estimate.status = FilledLengthStatus::kTooSlow;
    return estimate;
  }
  const double r_per_Pa = model.nozzle_kg / (model.viscosity_Pa_s * model.mass_per_length_kg_per_m * c_m_per_s);
  const double r = pressure_Pa * r_per_Pa;                // (E1)
  const double x = r / (model.theta2_per_m * (1.0 - r));  // (E2)
  if (!(r < 1.0) || x < -kTolerance_m || x > model.length_m + kTolerance_m) {
    estimate.status = FilledLengthStatus::kInvalid;
    return estimate;
  }
  estimate.x_per_r = 1.0 / (model.theta2_per_m * (1.0 - r) * (1.0 - r));  // (E3)
  estimate.x_per_Pa = estimate.x_per_r * r_per_Pa;
  estimate.x_m = std::clamp(x, 0.0, model.length_m);
  if (estimate.x_m != x) estimate.status = FilledLengthStatus::kClamped;
  return estimate;
}

}  // namespace meltbench::estimator
