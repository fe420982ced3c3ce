#include "controller/estimator/length_model.hpp"

#include <algorithm>

namespace meltbench::estimator {

namespace {

constexpr std::size_t kMostIntervals = 8192;  // A screw's length at the slowest screw, and more.
constexpr double kFullest = 0.95;             // A fuller channel would make the step stiff.

}  // namespace

LengthModel::LengthModel(const law::BizoneModel& model, double correction_m)
    : model_{model}, correction_m_{correction_m}, entered_{kMostIntervals} {}

void LengthModel::start(double x_m, double U, double s_m) {
  entered_.clear();
  U_before_ = std::clamp(U, 0.0, kFullest);
  entered_.push_back({s_m, U_before_});
  s_m_ = s_m;
  entered_until_m_ = s_m;
  x_m_ = x_m;
  started_ = true;
}

void LengthModel::add_feed(double U, double s_m) {
  if (!started_ || !(s_m > entered_until_m_)) return;
  entered_until_m_ = s_m;
  if (entered_.full()) entered_.pop_front();
  entered_.push_back({s_m, std::clamp(U, 0.0, kFullest)});
}

/// What entered at y; what has passed there is forgotten.
double LengthModel::ratio_at(double y_m) {
  while (!entered_.empty() && entered_.front().until_m < y_m) {
    U_before_ = entered_.front().U;
    entered_.pop_front();
  }
  // Where the newest report is still missing: as before.
  return entered_.empty() ? U_before_ : entered_.front().U;
}

void LengthModel::advance(double s_m, double x_measured_m) {
  const double ds = s_m - s_m_;
  if (!started_ || !(ds > 0.0)) return;
  s_m_ = s_m;
  const double u = ratio_at(s_m - (model_.length_m - x_m_));
  const double rate = (u - model_.holding_ratio(x_m_)) / (1.0 - u) + (x_measured_m - x_m_) / correction_m_;  // (E4)
  x_m_ = std::clamp(x_m_ + rate * ds, 0.0, model_.length_m);
}

}  // namespace meltbench::estimator
