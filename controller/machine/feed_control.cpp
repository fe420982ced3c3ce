#include "controller/machine/feed_control.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "controller/machine/objects.hpp"
#include "controller/machine/serial_feeder.hpp"

namespace meltbench::machine {

namespace {

using config::BoardKind;

std::string_view explain_refusal(law::PredictionStatus status) {
  if (status == law::PredictionStatus::kInfeasible) {
    return "its prediction is not defined here, the speed fluctuates too fast for the delay; exact_predictor has no "
           "such limit";
  }
  return "a measurement or a history is not a number";
}

BoardFacts collect_facts(const ControllerSettings& settings, const BusManager& bus, const FeederFacts& feeder) {
  const NodeBoot& drive = bus.boot(BoardKind::kScrewDrive);
  const NodeBoot& pressure = bus.boot(BoardKind::kMeltPressure);
  const auto to_us = [](std::uint32_t us) { return us * 1us; };
  const double increments = drive.value<std::uint32_t>(drive_object::kEncoderIncrements);
  const double revolutions = drive.value<std::uint32_t>(drive_object::kEncoderRevolutions);
  constexpr double kPaPerBar = 1e5;
  BoardFacts facts;
  facts.metres_per_increment = settings.pitch_m * revolutions / std::max(increments, 1.0);
  facts.Pa_per_count = kPaPerBar * std::pow(10.0, -pressure.value<std::uint8_t>(pressure_object::kDigits));
  facts.feeder_latency = feeder.latency;
  facts.feeder_cycle = feeder.cycle;
  facts.pressure_latency = to_us(pressure.value<std::uint32_t>(pressure_object::kLatency));
  facts.pressure_period = to_us(pressure.value<std::uint32_t>(pressure_object::kSamplePeriod));
  return facts;
}

}  // namespace

FeedControl::FeedControl(const ControllerSettings& settings)
    : settings_{settings},
      set_points_{settings.set_points},
      pressure_id_{settings.board(BoardKind::kMeltPressure).node_id},
      loop_{std::make_unique<LengthLoop>(settings, BoardFacts{})},
      safe_speed_m_per_s_{settings.sequence ? 0.0 : settings.model.speed_m_per_s},
      safe_feeds_{!settings.sequence} {
  const BoardSettings& feeder = settings.board(BoardKind::kFeeder);
  if (feeder.is_on_line()) {
    feeder_ = std::make_unique<SerialFeeder>(settings, safe_flow_kg_per_s());
  } else {
    feeder_ = std::make_unique<CanFeeder>(feeder.node_id);
  }
}

void FeedControl::connect(const BusManager& bus) {
  facts_ = collect_facts(settings_, bus, feeder_->facts(bus));
  last_asked_kg_per_s_.reset();
  unechoed_since_.reset();
  make_loop();
}

void FeedControl::make_loop() {
  loop_ = std::make_unique<LengthLoop>(settings_, facts_);
  loop_->select_set_point(set_point_);
}

void FeedControl::set_material(const MaterialSettings& material) {
  settings_.model = material.filled;
  settings_.viscosity = material.viscosity;
  make_loop();
}

bool FeedControl::take(const can::CanFrame& frame, Instant sync_at) {
  using canopen::cob_id::tpdo;
  if (feeder_->take(frame, sync_at)) return true;
  if (frame.id == tpdo(pressure_object::kSampleTpdo, pressure_id_)) {
    if (const auto report = parse_pressure_report(frame)) {
      std::optional<Nanos> age;
      if (report->age_us != kAgeSaturated) age = report->age_us * 1us;
      pressure_ = {sync_at, report->pressure_counts, age, report->status == 0};
    }
    return true;
  }
  if (frame.id == tpdo(pressure_object::kMeltTpdo, pressure_id_)) {
    constexpr double kTenths = 0.1;
    const auto report = parse_melt_temperature(frame);
    if (report && report->status == 0) T_melt_degC_ = kTenths * report->T_0p1degC;
    return true;
  }
  return false;
}

unsigned FeedControl::close_cycle(const std::optional<ScrewSample>& screw) {
  const std::optional<FeedSample> feed = feeder_->take_sample();
  const unsigned missed = (feed || !feeder_->reports_at_sync() ? 0U : 1U) + (pressure_ ? 0U : 1U);
  if (T_melt_degC_ && settings_.viscosity.per_K > 0.0) {
    const double colder_K = settings_.viscosity.at_degC - *T_melt_degC_;
    loop_->note_viscosity(settings_.model.viscosity_Pa_s * std::exp(settings_.viscosity.per_K * colder_K));
  }
  if (screw) loop_->add(*screw);  // First: feed and pressure are placed by the screw's clock and speed.
  if (feed) {
    loop_->add(*feed);
    check_echo(*feed);
  }
  if (pressure_) loop_->add(*pressure_);
  pressure_.reset();
  return missed;
}

/// Whether the feeder does what it was asked, but for what is still under way: that is over after a moment.
void FeedControl::check_echo(const FeedSample& sample) {
  constexpr double kToleranceShare = 0.02;  // Of a full screw: quantised flow, and commands that change.
  if (!last_asked_kg_per_s_) return;
  const double full = settings_.model.feed_kg_per_s(1.0, settings_.model.speed_m_per_s);
  if (std::abs(sample.flow_kg_per_s - *last_asked_kg_per_s_) <= kToleranceShare * full) {
    unechoed_since_.reset();
  } else if (!unechoed_since_) {
    unechoed_since_ = sample.at;
  }
}

safety::Observation FeedControl::observe(Instant now, Instant ready_at) const {
  const auto age = [&](Instant at) { return now - std::max(at, ready_at); };
  safety::Observation seen;
  seen.pressure_age = age(loop_->measured_at());
  seen.screw_age = age(loop_->screw_at());
  seen.feed_age = age(loop_->feed_at());
  if (const auto since = loop_->implausible_since()) seen.implausible_time = now - *since;
  if (const auto since = loop_->disagrees_since()) seen.disagreement_time = now - *since;
  if (unechoed_since_) seen.unechoed_time = now - *unechoed_since_;
  if (loop_->is_pressure_good()) seen.pressure_Pa = loop_->pressure_Pa();
  if (loop_->has_estimate()) seen.filled_length_m = loop_->newest_x_m();
  return seen;
}

std::optional<Trouble> FeedControl::control(Instant sync_at, Instant now, Outbox& out) {
  command_ = loop_->calc(sync_at, now);
  const bool refused =
      command_.status == law::PredictionStatus::kInfeasible || command_.status == law::PredictionStatus::kBadInput;
  if (refused || !std::isfinite(command_.flow_kg_per_s)) {
    return Trouble{"law-refused", fmt::format("{} refuses: {}", settings_.law, explain_refusal(command_.status))};
  }
  if (command_.status == law::PredictionStatus::kHistoryTooShort && !history_warned_) {
    history_warned_ = true;
    out.report(Severity::kWarning, now, "history-too-short",
               "the measurement is older than the feed history that is kept; the oldest feed stands in");
  }
  send_flow(now, command_.flow_kg_per_s, out);
  return {};
}

void FeedControl::feed(FeedMode mode, Instant now, Outbox& out) {
  command_ = {.U = 0.0, .P_m = loop_->x_m()};
  if (mode == FeedMode::kOpenLoop) command_.U = settings_.model.holding_ratio(set_point_m());
  send_flow(now, settings_.model.feed_kg_per_s(command_.U, std::max(loop_->speed_m_per_s(), 0.0)), out);
}

void FeedControl::go_safe(Instant now, Outbox& out) {
  const double flow = calc_safe_now_kg_per_s(now);
  command_.U = flow > 0.0 ? settings_.model.holding_ratio(set_point_m()) : 0.0;
  send_flow(now, flow, out);
}

/// The safe flow is for a screw that turns and a filled zone that ends somewhere: less onto a screw that is slower or
/// stands, and nothing onto one that is full.
double FeedControl::calc_safe_now_kg_per_s(Instant now) const {
  constexpr double kMuchSlower = 0.7;  // The published screws swing by 40 %, but for seconds.
  const bool full = loop_->has_estimate() && loop_->newest_x_m() >= settings_.limits.max_filled_length_m;
  constexpr Nanos kUnseen = 500ms;  // A screw that has not been heard for so long may stand.
  if (full || !(safe_speed_m_per_s_ > 0.0) || now - loop_->screw_at() > kUnseen) return 0.0;
  const double share = std::max(loop_->speed_m_per_s() / safe_speed_m_per_s_, 0.0);
  return safe_flow_kg_per_s() * (share < kMuchSlower ? share : 1.0);
}

void FeedControl::send_flow(Instant now, double flow_kg_per_s, Outbox& out) {
  command_.flow_kg_per_s = flow_kg_per_s;
  last_asked_kg_per_s_ = flow_kg_per_s;
  feeder_->command(now, flow_kg_per_s, out);
  note_sent();
}

void FeedControl::note_sent() {
  if (const auto sent = feeder_->take_sent()) loop_->note_sent(sent->at, sent->flow_kg_per_s);
}

void FeedControl::forget_set_points_before(Instant now) {
  const auto first = set_points_.begin() + 1;
  set_points_.erase(first,
                    std::find_if(first, set_points_.end(), [&](const SetPoint& one) { return one.from >= now; }));
  settings_.set_points = set_points_;
}

bool FeedControl::run_set_points(Instant now) {
  const std::size_t before = set_point_;
  while (set_point_ + 1 < set_points_.size() && set_points_[set_point_ + 1].from <= now) ++set_point_;
  if (set_point_ == before) return false;
  loop_->select_set_point(set_point_);
  return true;
}

Instant FeedControl::next_set_point() const {
  return set_point_ + 1 < set_points_.size() ? set_points_[set_point_ + 1].from : Instant::never();
}

bool FeedControl::set_safe(double speed_m_per_s, bool feeds) {
  const bool changed = speed_m_per_s != safe_speed_m_per_s_ || feeds != safe_feeds_;
  safe_speed_m_per_s_ = speed_m_per_s;
  safe_feeds_ = feeds;
  return changed;
}

double FeedControl::safe_flow_kg_per_s() const {
  if (settings_.safe_feed == SafeFeed::kStop || !safe_feeds_) return 0.0;
  return settings_.model.feed_kg_per_s(settings_.model.holding_ratio(set_point_m()), safe_speed_m_per_s_);
}

}  // namespace meltbench::machine
