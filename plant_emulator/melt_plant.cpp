#include "plant_emulator/melt_plant.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>

namespace meltbench::emulator {

namespace {

constexpr std::size_t kScalars = 10;  // Before the profile.
constexpr Nanos kMaxLag = 10ms;       // So that what nobody samples is not stale in the recording.

std::vector<SignalInfo> make_melt_signals() {
  std::vector<SignalInfo> signals{
      {"melt.front_m"},         {"melt.front_speed_m_per_s"}, {"melt.T_inlet_degC"},    {"melt.T_nozzle_degC"},
      {"melt.q_f_W_per_m2"},    {"melt.solid_margin_K"},      {"melt.liquid_margin_K"}, {"melt.status"},
      {"melt.energy_stored_m"}, {"melt.energy_residual_m"}};
  for (std::size_t i = 0; i < kProfilePoints; ++i) signals.push_back({fmt::format("melt.T_{:02}_degC", i)});
  return signals;
}

double x_of_point(std::size_t point, double length_m) {
  return length_m * static_cast<double>(point) / static_cast<double>(kProfilePoints - 1);
}

/// What happened, and what it means.
std::pair<std::string_view, std::string_view> describe(plant::MeltStatus status) {
  switch (status) {
    case plant::MeltStatus::kRunning:
      break;
    case plant::MeltStatus::kSolidLost:
      return {"solid-lost", "no granules are left in the barrel: the front has reached the inlet"};
    case plant::MeltStatus::kMeltLost:
      return {"melt-lost", "no melt is left in the barrel: the front has reached the nozzle"};
    case plant::MeltStatus::kSuperheated:
      return {"superheated", "granules are more than 10 K above the melting temperature: the model ends here"};
    case plant::MeltStatus::kDiverged:
      return {"melt-diverged", "the step found no front speed"};
  }
  return {"melt-running", "the melting front is in the barrel again"};
}

}  // namespace

std::span<const SignalInfo> melt_signals() {
  static const std::vector<SignalInfo> signals = make_melt_signals();
  return signals;
}

void read_melt_signals(const plant::MeltFront& melt, double length_m, double front_m, double flux_W_per_m2,
                       std::span<double> values) {
  const plant::MeltValidity validity = melt.validity();
  const std::array<double, kScalars> scalars{front_m,
                                             melt.front_speed_m_per_s(),
                                             melt.T_inlet_degC(),
                                             melt.T_nozzle_degC(),
                                             flux_W_per_m2,
                                             validity.solid_margin_K,
                                             validity.liquid_margin_K,
                                             static_cast<double>(melt.status()),
                                             melt.energy_stored_m(),
                                             melt.energy_residual_m()};
  std::copy(scalars.begin(), scalars.end(), values.begin());
  for (std::size_t i = 0; i < kProfilePoints; ++i) values[kScalars + i] = melt.T_degC(x_of_point(i, length_m));
}

void read_standing_signals(const std::function<double(double x_m)>& T_at, double length_m, double front_m,
                           std::span<double> values) {
  constexpr double kNothing = board::Process::kNothing;
  const std::array<double, kScalars> scalars{
      front_m,  0.0,      T_at(0.0), T_at(length_m),
      0.0,      kNothing, kNothing,  static_cast<double>(plant::MeltStatus::kRunning),
      kNothing, kNothing};
  std::copy(scalars.begin(), scalars.end(), values.begin());
  for (std::size_t i = 0; i < kProfilePoints; ++i) values[kScalars + i] = T_at(x_of_point(i, length_m));
}

void MeltStatusReport::tell(plant::MeltStatus status, Instant now, Outbox& out) {
  if (status == told_) return;
  told_ = status;
  const auto [code, text] = describe(status);
  const Severity severity = status == plant::MeltStatus::kRunning ? Severity::kInfo : Severity::kFault;
  out.report(severity, now, std::string{code}, std::string{text});
}

MeltPlant::MeltPlant(const MeltPlantSettings& settings)
    : settings_{settings},
      column_{settings.melt, settings.numerics},
      barrel_{plant::MeltBarrel::uniform(settings.T_barrel_degC)},
      signals_{{"plant.speed_m_per_s"}, {"plant.conveyed_m"}},
      speed_m_per_s_{settings.speed_m_per_s} {
  signals_.insert(signals_.end(), melt_signals().begin(), melt_signals().end());
  signals_.push_back({"melt.length_m"});  // What a report needs to draw the profile and the front to scale.
  signals_.push_back({"melt.T_melt_degC"});
  if (settings.start == MeltStart::kLinear) {
    column_.melt().start_linear(settings.start_front_m, settings.start_T_inlet_degC);
  } else {
    const plant::MeltSteadyState steady = plant::calc_melt_steady_state(settings.melt, settings.T_barrel_degC,
                                                                        settings.speed_m_per_s, settings.start_front_m);
    column_.melt().start_steady(steady);
    column_.set_inlet(plant::MeltInlet::flux(steady.inlet_flux_W_per_m2));
  }
  column_.place(now_, conveyed_m_);
}

void MeltPlant::advance_to(Instant to) {
  if (to <= now_) return;
  conveyed_m_ += speed_m_per_s_ * to_s(to - now_);
  now_ = to;
}

void MeltPlant::settle(Instant now) {
  if (now - column_.solved_to() >= kMaxLag) catch_up();
}

void MeltPlant::set_screw_rev_per_s(double screw_rev_per_s) {
  catch_up();
  speed_m_per_s_ = std::max(screw_rev_per_s * settings_.pitch_m, 0.0);
}

void MeltPlant::set_inlet(const plant::MeltInlet& inlet) {
  catch_up();
  column_.set_inlet(inlet);
}

double MeltPlant::front_m() {
  catch_up();
  return column_.melt().front_m();
}

double MeltPlant::T_inlet_degC() {
  catch_up();
  return column_.melt().T_inlet_degC();
}

void MeltPlant::read_signals(std::span<double> values) const {
  values[0] = speed_m_per_s_;
  values[1] = conveyed_m_;
  read_melt_signals(column_.melt(), settings_.melt.length_m, column_.front_m(now_), column_.flux(now_).now_W_per_m2,
                    values.subspan(2));
  values[signals_.size() - 2] = settings_.melt.length_m;
  values[signals_.size() - 1] = settings_.melt.T_melt_degC;
}

}  // namespace meltbench::emulator
