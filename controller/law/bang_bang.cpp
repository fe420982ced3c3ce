#include "controller/law/bang_bang.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace meltbench::law {

namespace {

// (1 - e^{-a y})/(1 - e^{-a X}), and its limit y/X for a -> 0.
double calc_share(double a, double y, double X) {
  return a > 0.0 ? std::expm1(-a * y) / std::expm1(-a * X) : y / X;
}

void require(bool holds, const char* name, double value, double low, double high) {
  if (!holds) {
    throw std::invalid_argument(fmt::format("bang-bang law: {} = {}, must be in ({}, {})", name, value, low, high));
  }
}

}  // namespace

double calc_gain_per_m(double S_per_m, double X_m, double A) {
  const double S = S_per_m, X = X_m;
  if (!(S * X > A)) return 0.0;
  // f(a) = S (1 - e^{-a X}) - a A is concave with f(0) = 0, so its maximum splits the spurious root from ours.
  double low = std::log(S * X / A) / X, high = S / A;
  for (int i = 0; i < 200 && high - low > 1e-15 * high; ++i) {
    const double a = 0.5 * (low + high);
    const double f = -S * std::expm1(-a * X) - a * A;  // (C4)
    (f > 0.0 ? low : high) = a;
  }
  return 0.5 * (low + high);
}

BangBang::BangBang(const BizoneModel& model, const BangBangSettings& settings)
    : L_{model.length_m}, x_set_{settings.x_set_m}, v_max_{settings.max_fill} {
  require(L_ > 0.0 && std::isfinite(L_), "length_m", L_, 0.0, INFINITY);
  require(model.theta2_per_m > 0.0, "theta2_per_m", model.theta2_per_m, 0.0, INFINITY);
  require(x_set_ > 0.0 && x_set_ < L_, "x_set_m", x_set_, 0.0, L_);
  v_set_ = model.holding_ratio(x_set_);
  require(v_max_ > v_set_ && v_max_ < 1.0, "max_fill", v_max_, v_set_, 1.0);
  const double dS = settings.slope_margin_per_m;
  require(dS > 0.0 && std::isfinite(dS), "slope_margin_per_m", dS, 0.0, INFINITY);
  S_min_ = std::max((v_max_ - v_set_) / x_set_, v_set_ / (L_ - x_set_));  // [D17] (31)
  S_ = S_min_ + dS;
  a_l_ = calc_gain_per_m(S_, x_set_, v_max_ - v_set_);  // [D17] (32)
  a_r_ = calc_gain_per_m(S_, L_ - x_set_, v_set_);      // [D17] (33)
}

double BangBang::calc_U(double x_m) const {
  const double x = std::clamp(x_m, 0.0, L_);
  const double U = x <= x_set_ ? v_set_ + (v_max_ - v_set_) * calc_share(a_l_, x_set_ - x, x_set_)
                               : v_set_ - v_set_ * calc_share(a_r_, x - x_set_, L_ - x_set_);  // (C3)
  return std::clamp(U, 0.0, v_max_);
}

}  // namespace meltbench::law
