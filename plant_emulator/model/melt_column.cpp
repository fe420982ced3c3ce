#include "plant_emulator/model/melt_column.hpp"

namespace meltbench::plant {

void MeltColumn::place(Instant at, double conveyed_m) {
  solved_to_ = at;
  conveyed_m_ = conveyed_m;
  held_ = false;
  flux_.now_W_per_m2 = melt_.inlet_flux_W_per_m2();
}

void MeltColumn::hold(Instant at) {
  flux_ = flux(at);
  flux_.now_W_per_m2 = 0;
  solved_to_ = at;
  held_ = true;
}

void MeltColumn::catch_up(Instant to, double conveyed_m, const MeltBarrel& barrel) noexcept {
  if (to < solved_to_ + kLeastStep) return;
  const double dt_s = to_s(to - solved_to_);
  const double speed_m_per_s = (conveyed_m - conveyed_m_) / dt_s;
  solved_to_ = to;
  conveyed_m_ = conveyed_m;
  if (!runs()) {
    flux_.now_W_per_m2 = 0;
    return;
  }
  melt_.advance(dt_s, {.speed_m_per_s = speed_m_per_s, .inlet = inlet_, .barrel = barrel});
  flux_.now_W_per_m2 = melt_.inlet_flux_W_per_m2();
  flux_.total_J_per_m2 += dt_s * melt_.mean_inlet_flux_W_per_m2();
  if (flux_.now_W_per_m2 <= inlet_.min_W_per_m2) flux_.at_min_s += dt_s;
  if (flux_.now_W_per_m2 >= inlet_.max_W_per_m2) flux_.at_max_s += dt_s;
}

double MeltColumn::front_m(Instant at) const {
  return melt_.front_m() + (runs() ? melt_.front_speed_m_per_s() * to_s(at - solved_to_) : 0.0);
}

InletFlux MeltColumn::flux(Instant at) const {
  InletFlux flux = flux_;
  flux.total_J_per_m2 += flux.now_W_per_m2 * to_s(at - solved_to_);
  return flux;
}

}  // namespace meltbench::plant
