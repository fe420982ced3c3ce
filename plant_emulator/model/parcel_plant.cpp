#include "plant_emulator/model/parcel_plant.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace meltbench::plant {

ParcelPlant::ParcelPlant(double length_m, double theta2_per_m, double x0_m, double U_before, std::size_t max_parcels)
    : L_{length_m}, theta2_{theta2_per_m}, parcels_(max_parcels), x_{x0_m}, y_{x0_m - length_m} {
  constexpr double kForEver = -std::numeric_limits<double>::infinity();
  last_ = Parcel{{kForEver, kForEver}, {0.0, 0.0}, U_before};
  parcels_.push_back(last_);
  in_transit_m_ = U_before * (L_ - x_);
  content0_m_ = content_m();
}

void ParcelPlant::advance(ClockPoint to, double U) {
  append(to, U);
  now_ = to;
  consume();
}

// (D10), the solution of (D8) after the distance d.
double ParcelPlant::calc_P(double P0, double d, double U) const {
  const double r = theta2_ * (1.0 - U);  // > 0, because U <= kMaxFillRatio.
  return P0 + (P0 - U / r) * std::expm1(-r * d);
}

// Solves (D9), d + L - P(d) = rest, for d in [0, d_max]. The left side grows with d; Newton, kept inside by bisection.
// Written in d and in the rise P - x, which are both small, so that no digits are lost by subtracting.
double ParcelPlant::calc_arrival_distance(double rest, double d_max, double U) const {
  const double r = theta2_ * (1.0 - U);
  const double to_go = rest - (L_ - x_);
  double low = 0.0, high = d_max;
  double d = std::clamp(to_go / ((1.0 - U) * (1.0 + theta2_ * x_)), low, high);
  for (int i = 0; i < 60; ++i) {
    const double rise = (x_ - U / r) * std::expm1(-r * d);
    const double excess = d - rise - to_go;
    (excess > 0.0 ? high : low) = d;
    double next = d - excess / ((1.0 - U) * (1.0 + theta2_ * (x_ + rise)));
    if (!(next >= low && next <= high)) next = 0.5 * (low + high);
    const bool settled =
        std::abs(next - d) <= 1e-8 * d;  // Newton doubles the digits: `next` is exact but for rounding.
    d = next;
    if (settled) break;
  }
  return d;
}

void ParcelPlant::append(ClockPoint to, double U) {
  const double entered = to.s_m - now_.s_m;
  if (!(entered > 0.0)) return;
  inflow_m_ += U * entered;
  in_transit_m_ += U * entered;
  last_ = Parcel{now_, to, U};
  if (!parcels_.full()) {
    parcels_.push_back(last_);
    return;
  }
  Parcel& newest = parcels_.back();
  const double merged_m = newest.end.s_m - newest.begin.s_m;
  newest.U = (newest.U * merged_m + U * entered) / (merged_m + entered);
  newest.end = to;
  ++merged_parcels_;
}

void ParcelPlant::consume() {
  flooded_ = false;
  while (!parcels_.empty()) {
    const Parcel parcel = parcels_.front();
    const double d_left = parcel.end.s_m - y_;
    const double P_end = calc_P(x_, d_left, parcel.U);
    if (P_end >= L_) {
      flood(parcel);
      if (y_ < parcel.end.s_m) return;
      parcels_.pop_front();
      continue;
    }
    if (parcel.end.s_m + L_ - P_end > now_.s_m) {
      const double d = calc_arrival_distance(now_.s_m - y_, d_left, parcel.U);
      convey(d, calc_P(x_, d, parcel.U), parcel.U);
      return;
    }
    convey(d_left, P_end, parcel.U);
    y_ = parcel.end.s_m;  // Not y + d: rounding must not add up.
    parcels_.pop_front();
  }
}

// The material between y and y + d reaches the filled zone, whose end moves from x to P_end.
void ParcelPlant::convey(double d, double P_end, double U) {
  const double r = theta2_ * (1.0 - U);
  // By (D4) and (D9) v ds = r P dy, (D11). Simpson's rule, so that a wrong P shows in the mass balance.
  const int pieces = 1 + static_cast<int>(r * d / 0.05);
  const double h = d / pieces;
  double P0 = x_;
  for (int i = 0; i < pieces; ++i) {
    const double P_mid = calc_P(P0, 0.5 * h, U);
    const double P1 = i + 1 == pieces ? P_end : calc_P(P0, h, U);
    outflow_m_ += h * r * (P0 + 4.0 * P_mid + P1) / 6.0;
    P0 = P1;
  }
  in_transit_m_ -= U * d;
  y_ += d;
  x_ = P_end;
}

// This parcel would fill the barrel: the part up to P = L is conveyed, and what has entered after that overflows.
void ParcelPlant::flood(const Parcel& parcel) {
  const double U = parcel.U;
  const double r = theta2_ * (1.0 - U);
  if (x_ < L_) {
    const double d_full = -std::log((L_ - U / r) / (x_ - U / r)) / r;  // (D10) solved for P = L.
    if (y_ + d_full > now_.s_m) {                                      // At P = L it arrives where it enters, s = y.
      const double d = calc_arrival_distance(now_.s_m - y_, parcel.end.s_m - y_, U);
      convey(d, std::min(calc_P(x_, d, U), L_), U);
      return;
    }
    convey(d_full, L_, U);
  }
  flooded_ = true;
  const double d = std::min(parcel.end.s_m, now_.s_m) - y_;
  const double v = theta2_ * L_ / (1.0 + theta2_ * L_);
  outflow_m_ += v * d;
  spill_m_ += (U - v) * d;  // (D13)
  in_transit_m_ -= U * d;
  y_ += d;
}

double ParcelPlant::calc_content_m() const {
  double content = x_;
  double begin = y_;
  for (std::size_t i = 0; i < parcels_.size(); ++i) {
    content += parcels_[i].U * (parcels_[i].end.s_m - begin);
    begin = parcels_[i].end.s_m;
  }
  return content;
}

}  // namespace meltbench::plant
