#include "plant_emulator/model/bizone_extruder.hpp"

#include <algorithm>
#include <cmath>

namespace meltbench::plant {

namespace {

constexpr double kMaxSpeedChange = 0.001;  // Of c within a substep; U is averaged over it, (D14).

BizoneParameters checked(const BizoneParameters& parameters) {
  parameters.check();
  return parameters;
}

std::variant<ParcelPlant, FrozenDelayPlant> make_plant(const BizoneParameters& p, const ScrewClock& clock) {
  const double U_before = p.U_before_start.value_or(p.outflow_ratio(p.x0_m));
  if (p.delay_reading == DelayReading::kPaper) {
    return FrozenDelayPlant(p.length_m, p.theta2_per_m(), p.x0_m, U_before, clock);
  }
  return ParcelPlant(p.length_m, p.theta2_per_m(), p.x0_m, U_before);
}

double not_negative(double value) {
  return value > 0.0 && std::isfinite(value) ? value : 0.0;
}

}  // namespace

BizoneExtruder::BizoneExtruder(const BizoneParameters& parameters)
    : parameters_{checked(parameters)},
      speed_before_m_per_s_{parameters.speed_m_per_s},
      clock_{parameters.speed_m_per_s, parameters.fluctuation, parameters.fluctuation_rad_per_s,
             parameters.fluctuation_phase_rad},
      plant_{make_plant(parameters, clock_)},
      feed_kg_per_s_{parameters.holding_feed_kg_per_s(parameters.x0_m)} {}

void BizoneExtruder::set_feed_kg_per_s(double feed_kg_per_s) {
  feed_kg_per_s_ = not_negative(feed_kg_per_s);
}

void BizoneExtruder::set_speed_m_per_s(double speed_m_per_s) {
  const double speed = not_negative(speed_m_per_s);
  if (speed == clock_.nominal_speed_m_per_s()) return;
  clock_.set_speed(t_, speed);
}

void BizoneExtruder::set_nozzle_kg(double nozzle_kg) {
  auto* parcels = std::get_if<ParcelPlant>(&plant_);
  if (parcels == nullptr) return;
  parameters_.nozzle_kg = nozzle_kg;
  parcels->set_theta2_per_m(parameters_.theta2_per_m());
}

void BizoneExtruder::set_density_kg_per_m3(double density_kg_per_m3) {
  if (!std::holds_alternative<ParcelPlant>(plant_)) return;
  parameters_.density_kg_per_m3 = density_kg_per_m3;
  set_nozzle_kg(parameters_.nozzle_kg);
}

void BizoneExtruder::advance_to(Instant to) {
  if (to <= now_) return;
  const double t_end = to_s(to);
  const double span = t_end - t_;
  const double eps = parameters_.fluctuation;
  const double change = eps * parameters_.fluctuation_rad_per_s / (1.0 - eps) * span;
  const int pieces = static_cast<int>(std::clamp(std::ceil(change / kMaxSpeedChange), 1.0, double{kMaxSubsteps}));
  const double t_begin = t_;
  for (int i = 1; i < pieces; ++i) advance_substep(t_begin + span * i / pieces);
  advance_substep(t_end);
  now_ = to;
}

void BizoneExtruder::advance_substep(double t_next) {
  const double kg_per_m = parameters_.mass_per_length_kg_per_m();
  const double capacity_kg = kg_per_m * (clock_.conveyed_m(t_next) - clock_.conveyed_m(t_));
  const double fed_kg = feed_kg_per_s_ * (t_next - t_);
  const double accepted_kg = std::min(fed_kg, kMaxFillRatio * capacity_kg);
  const double U = capacity_kg > 0.0 ? accepted_kg / capacity_kg : 0.0;  // Mean of (D1), (D14).
  rejected_feed_kg_ += fed_kg - accepted_kg;
  if (auto* parcels = std::get_if<ParcelPlant>(&plant_)) {
    parcels->advance(ClockPoint{t_next, clock_.conveyed_m(t_next)}, U);
  } else {
    std::get<FrozenDelayPlant>(plant_).advance(t_next, U, clock_);
  }
  t_ = t_next;
}

double BizoneExtruder::x_m() const {
  return std::visit([](const auto& plant) { return plant.x_m(); }, plant_);
}

double BizoneExtruder::encoder_m() const {
  return parameters_.fluctuation_place == FluctuationPlace::kScrew ? clock_.conveyed_m(t_)
                                                                   : clock_.nominal_conveyed_m(t_);
}

double BizoneExtruder::encoder_m_per_s() const {
  return parameters_.fluctuation_place == FluctuationPlace::kScrew ? clock_.speed_m_per_s(t_)
                                                                   : clock_.nominal_speed_m_per_s();
}

double BizoneExtruder::flow_kg_per_s() const {
  return parameters_.mass_per_length_kg_per_m() * clock_.speed_m_per_s(t_) * parameters_.outflow_ratio(x_m());  // (D5)
}

double BizoneExtruder::pressure_Pa() const {
  return parameters_.viscosity_Pa_s * flow_kg_per_s() / parameters_.nozzle_kg;  // (D6)
}

BizoneOutputs BizoneExtruder::outputs() const {
  BizoneOutputs out;
  const double c = clock_.speed_m_per_s(t_);
  out.speed_m_per_s = c;
  out.conveyed_m = clock_.conveyed_m(t_);
  out.encoder_m = encoder_m();
  out.encoder_m_per_s = encoder_m_per_s();
  out.feed_kg_per_s = feed_kg_per_s_;
  out.U = c > 0.0 ? std::min(feed_kg_per_s_ / (parameters_.mass_per_length_kg_per_m() * c), kMaxFillRatio) : 0.0;
  out.flow_kg_per_s = flow_kg_per_s();
  out.pressure_Pa = pressure_Pa();
  out.rejected_feed_kg = rejected_feed_kg_;
  std::visit(
      [&](const auto& plant) {
        out.x_m = plant.x_m();
        out.U_at_interface = plant.U_at_interface();
        out.flooded = plant.flooded();
        out.spill_m = plant.spill_m();
        read_plant(plant, out);
      },
      plant_);
  out.feasible = out.delay_rate < 1.0;
  return out;
}

// (D17): when did the material enter that arrives now, and how does that change?
void BizoneExtruder::read_plant(const ParcelPlant& plant, BizoneOutputs& out) const {
  out.mass_residual_m = plant.mass_residual_m();
  if (plant.flooded()) return;
  const ParcelPlant::Parcel& parcel = plant.arriving_parcel();
  const double y = plant.arriving_y_m();
  double phi = 0.0;
  double theta1_then = speed_before_m_per_s_;
  if (std::isfinite(parcel.begin.s_m)) {
    // Within a parcel theta1 did not change, so s grows in proportion to g, whatever theta1 was.
    const double g_begin = clock_.stretched_time_s(parcel.begin.t_s), g_end = clock_.stretched_time_s(parcel.end.t_s);
    const double share = (y - parcel.begin.s_m) / (parcel.end.s_m - parcel.begin.s_m);
    const double guess = parcel.begin.t_s + share * (parcel.end.t_s - parcel.begin.t_s);
    phi = clock_.calc_time_s(g_begin + share * (g_end - g_begin), guess);
    theta1_then = (parcel.end.s_m - parcel.begin.s_m) / (g_end - g_begin);
  } else {
    const double g = clock_.stretched_time_s(0.0) + y / speed_before_m_per_s_;
    phi = clock_.calc_time_s(g, g);
  }
  const double u = out.U_at_interface;
  const double c = out.speed_m_per_s;
  const double eps = parameters_.fluctuation;
  const double c_then =
      theta1_then * (1.0 + eps * std::cos(parameters_.fluctuation_rad_per_s * phi + parameters_.fluctuation_phase_rad));
  const double x_rate = c * (u - parameters_.outflow_ratio(out.x_m)) / (1.0 - u);
  out.delay_s = t_ - phi;
  out.delay_rate = 1.0 - (c + x_rate) / c_then;
}

// (D15), differentiated.
void BizoneExtruder::read_plant(const FrozenDelayPlant& plant, BizoneOutputs& out) const {
  out.mass_residual_m = plant.mass_residual_m(clock_);
  const double c = out.speed_m_per_s;
  if (!(c > 0.0) || plant.flooded()) return;
  const double u = out.U_at_interface;
  const double x_rate = c * (u - parameters_.outflow_ratio(out.x_m)) / (1.0 - u);
  const double way = parameters_.length_m - out.x_m;
  out.delay_s = way / c;
  out.delay_rate = -x_rate / c - way * clock_.acceleration_m_per_s2(t_) / (c * c);
}

}  // namespace meltbench::plant
