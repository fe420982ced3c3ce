#pragma once
/// Filled length from the pressure at the nozzle.

#include <cstdint>

#include "controller/law/bizone_model.hpp"

namespace meltbench::estimator {

enum class FilledLengthStatus : std::uint8_t {
  kOk,
  kClamped,  ///< Outside the barrel by up to kTolerance_m (noise, a flooded or empty barrel): x is the end of the
             ///< range.
  kTooSlow,  ///< The screw hardly turns: pressure says nothing about length. x is not to be used.
  kInvalid,  ///< Not a pressure of this extruder (r not in [0, 1), far out of range, NaN). x is not to be used.
};

/// An estimate and how good it is.
struct FilledLength {
  double x_m = 0.0;
  double x_per_Pa = 0.0;  ///< dx/d(dP) [m/Pa]: turns the transmitter's error into an error of x.
  double x_per_r = 0.0;   ///< dx/dr [m], (E3).
  FilledLengthStatus status = FilledLengthStatus::kOk;

  [[nodiscard]] bool usable() const {
    return status == FilledLengthStatus::kOk || status == FilledLengthStatus::kClamped;
  }
};

/// Inverts the nozzle and the filled zone, (E1), (E2):
///
///   r = dP Kd/(eta rho0 S_eff c),   x = r/(theta2 (1 - r)),   dx/dr = 1/(theta2 (1 - r)^2)
///
/// @param pressure_Pa  dP over the nozzle.
/// @param c_m_per_s    conveying speed at the time stamp of the pressure: both belong to the same instant.
[[nodiscard]] FilledLength calc_filled_length(const law::BizoneModel& model, double pressure_Pa, double c_m_per_s);

inline constexpr double kMinSpeedShare = 0.05;  ///< Of theta1; below it kTooSlow.
inline constexpr double kTolerance_m = 0.01;    ///< How far outside [0, L] is still noise.

}  // namespace meltbench::estimator
