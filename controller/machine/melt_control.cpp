#include "controller/machine/melt_control.hpp"

#include <cmath>

#include "controller/machine/objects.hpp"

namespace meltbench::machine {

using config::BoardKind;

MeltControl::MeltControl(const ControllerSettings& settings)
    : melt_{*settings.melt},
      sync_period_{settings.sync_period},
      camera_id_{settings.board(BoardKind::kMeltCamera).node_id},
      preconditioner_id_{settings.board(BoardKind::kPreconditioner).node_id} {
  make_loop();
}

void MeltControl::connect(const BusManager& bus) {
  const NodeBoot& camera = bus.boot(BoardKind::kMeltCamera);
  const NodeBoot& preconditioner = bus.boot(BoardKind::kPreconditioner);
  const auto to_us = [](std::uint32_t us) { return us * 1us; };
  metres_per_count_ = std::pow(10.0, -camera.value<std::uint8_t>(camera_object::kDigits));
  facts_.camera_period = to_us(camera.value<std::uint32_t>(camera_object::kSamplePeriod));
  facts_.camera_latency = to_us(camera.value<std::uint32_t>(camera_object::kLatency));
  facts_.inlet_period = to_us(preconditioner.value<std::uint32_t>(preconditioner_object::kSamplePeriod));
  facts_.inlet_latency = to_us(preconditioner.value<std::uint32_t>(preconditioner_object::kLatency));
  make_loop();
}

bool MeltControl::take(const can::CanFrame& frame, Instant sync_at) {
  using canopen::cob_id::tpdo;
  if (frame.id == tpdo(camera_object::kFrontTpdo, camera_id_)) {
    if (const auto report = parse_front_report(frame)) {
      std::optional<Nanos> age;
      if (report->age_10us != kAgeSaturated) age = report->age_10us * 10us;
      front_ = {sync_at, metres_per_count_ * report->front_counts, age, report->status == 0};
    }
    return true;
  }
  if (frame.id == tpdo(preconditioner_object::kTemperatureTpdo, preconditioner_id_)) {
    const auto report = parse_inlet_report(frame);
    if (report && std::isfinite(report->T_degC)) {
      std::optional<Nanos> age;
      if (report->age_us != kAgeSaturated) age = report->age_us * 1us;
      inlet_ = {sync_at, static_cast<double>(report->T_degC), age, report->status == 0, {}};
    }
    return true;
  }
  if (frame.id == tpdo(preconditioner_object::kFluxTpdo, preconditioner_id_)) {
    const auto flux = parse_flux_report(frame);
    if (flux && std::isfinite(*flux)) flux_ = static_cast<double>(*flux);
    return true;
  }
  return false;
}

unsigned MeltControl::close_cycle(double screw_speed_m_per_s, std::optional<double> T_barrel_degC,
                                  std::optional<double> T_coldest_degC) {
  const unsigned missed = (front_ ? 0U : 1U) + (inlet_ ? 0U : 1U) + (flux_ ? 0U : 1U);
  loop_->note_speed(screw_speed_m_per_s);
  loop_->note_barrel(T_barrel_degC.value_or(melt_.T_barrel_degC));
  loop_->note_coldest(T_coldest_degC);
  if (front_) loop_->add(*front_);
  if (inlet_) {
    inlet_->mean_flux_W_per_m2 = flux_;
    loop_->add(*inlet_);
  }
  front_.reset();
  inlet_.reset();
  flux_.reset();
  return missed;
}

bool MeltControl::is_measured_well() const {
  const safety::MeltObservation seen = loop_->observe();
  return loop_->is_running() && seen.front_coasted_m == 0.0 && seen.inlet_coasted_m == 0.0;
}

std::optional<Trouble> MeltControl::control(Instant sync_at, Outbox& out) {
  const std::optional<MeltRequest> request = loop_->calc(sync_at);
  const safety::MeltObservation seen = loop_->observe();
  if (const safety::MeltTrip why = safety::judge(melt_.limits, seen); why != safety::MeltTrip::kNone) {
    return Trouble{safety::code_of(why), safety::describe(why, melt_.limits, seen)};
  }
  const bool sound = request && std::isfinite(request->T_reference_degC) && std::isfinite(request->gain_W_per_m2K) &&
                     std::isfinite(request->feedforward_W_per_m2);
  if (!sound) return Trouble{"law-refused", melt_.law + " refuses: no steady state to aim at, or no number"};
  const bool inner = request->gain_W_per_m2K > 0.0;
  out.send(make_inlet_set_point(preconditioner_id_, static_cast<float>(request->T_reference_degC),
                                static_cast<float>(request->feedforward_W_per_m2)));
  out.send(make_inlet_mode(preconditioner_id_, static_cast<float>(request->gain_W_per_m2K),
                           inner ? PreconditionerMode::kInnerLoop : PreconditionerMode::kDirectFlux));
  return {};
}

void MeltControl::rest(Outbox& out) {
  if (loop_->is_running()) loop_->stop();
  out.send(make_inlet_mode(preconditioner_id_, 0.0F, PreconditionerMode::kOff));
  out.send(make_inlet_set_point(preconditioner_id_, static_cast<float>(melt_.T_barrel_degC), 0.0F));
}

void MeltControl::set_front(double front_set_m) {
  melt_.front_set_m = front_set_m;
  loop_->set_front(front_set_m);
}

void MeltControl::set_material(const MaterialSettings& material) {
  melt_.model = material.model;
  melt_.T_barrel_degC = material.T_barrel_degC;
  melt_.front_set_m = material.front_set_m;
  melt_.limits.T_melt_degC = material.model.T_melt_degC;
  melt_.limits.length_m = material.model.length_m;
  make_loop();
}

}  // namespace meltbench::machine
