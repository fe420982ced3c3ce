#include "controller/machine/controller.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "controller/machine/boot_plan.hpp"

namespace meltbench::machine {

namespace {

constexpr double kSecondsPerHour = 3600.0;
constexpr double kSecondsPerMinute = 60.0;
constexpr Instant kStartsLate{500ms};  // At wall-clock pace the first wake-up is some milliseconds behind the start.
constexpr double kSlowestShare = 0.1;  // Of the run's speed: a slower screw counts as standing for the front.

}  // namespace

std::string_view text(ControllerState state) {
  switch (state) {
    case ControllerState::kOff:
      return "off";
    case ControllerState::kBooting:
      return "booting";
    case ControllerState::kReady:
      return "ready";
    case ControllerState::kRunning:
      return "running";
    case ControllerState::kSafe:
      return "safe";
    case ControllerState::kFault:
      return "fault";
    case ControllerState::kHolding:
      return "holding";
  }
  return "?";
}

Controller::Controller(ControllerSettings settings)
    : settings_{std::move(settings)},
      feed_{settings_.has_length_loop() ? std::make_optional<FeedControl>(settings_) : std::nullopt},
      melt_{settings_.melt ? std::make_optional<MeltControl>(settings_) : std::nullopt},
      zones_{settings_.zones ? std::make_optional<ZoneControl>(settings_) : std::nullopt},
      sequence_{settings_.sequence ? std::make_optional<Sequence>(*settings_.sequence) : std::nullopt},
      screw_{settings_},
      bus_{settings_, feed_ ? feed_->safe_flow_kg_per_s() * kSecondsPerHour : 0.0},
      run_rev_per_s_{settings_.run_speed_rev_per_s()} {
  make_lines();
  make_signals();
}

void Controller::make_lines() {
  for (const config::RigLine& line : settings_.lines) {
    const auto number = static_cast<std::uint8_t>(masters_.size());
    masters_.emplace_back(number, timing_of(settings_, line.name), settings_.serial);
    const auto adopt = [&](config::BoardKind kind, SerialUnit& unit) {
      if (settings_.board(kind).line != line.name) return;
      masters_.back().add(unit);
      units_.push_back(&unit);
    };
    if (feed_ && feed_->feeder().serial() != nullptr) adopt(config::BoardKind::kFeeder, *feed_->feeder().serial());
    if (zones_) {
      for (const auto& zone : zones_->serial()) adopt(config::BoardKind::kHeater, *zone);
    }
    line_names_.push_back(line.name);
  }
  line_states_.assign(masters_.size(), LinkState::kUp);
}

void Controller::wake(const Wakeup& in, Outbox& out) {
  on_link(in.now, in.link, out);
  on_node(in.now, in.nodes.empty() ? can::ErrorState::kActive : in.nodes.front(), out);
  on_lines(in.now, in.lines, out);
  if (state_ == ControllerState::kOff) {
    // What has come until now is older than the reset, and would only mislead.
    state_ = ControllerState::kBooting;
    if (in.now > kStartsLate) join(in.now);
    bus_.start(in.now, out);
  } else {
    for (const can::StampedFrame& stamped : in.frames) on_frame(in.now, stamped.frame, out);
    for (const SerialArrival& arrival : in.serial) on_serial(in.now, arrival, out);
  }
  if (bus_.on_time(in.now, are_units_configured(), out)) begin(in.now, out);
  handle_troubles(in.now, out);
  run_timeline(in.now, out);
  close_cycle_if_due(in.now, out);
  bus_.send_heartbeat_if_due(in.now, out);
  if (bus_.send_sync_if_due(in.now, out)) {
    sync_at_ = in.now;
    cycle_deadline_ = in.now + settings_.sync_period / 2;
  }
  run_lines(in.now, out);
  out.wake_at(next_deadline());
}

Instant Controller::next_deadline() const {
  Instant next = std::min(bus_.next_deadline(), cycle_deadline_);
  for (const SerialMaster& master : masters_) next = std::min(next, master.next_deadline());
  if (!is_up() && state_ != ControllerState::kFault) return next;
  if (feed_ && is_up()) next = std::min(next, feed_->next_set_point());
  if (next_order_ < settings_.orders.size()) next = std::min(next, settings_.orders[next_order_].at);
  return next;
}

/// The machine has been running before this controller was: it goes on from what it finds. Nobody repeats the orders
/// that it has missed.
void Controller::join(Instant now) {
  joined_ = true;
  while (next_order_ < settings_.orders.size() && settings_.orders[next_order_].at < now) ++next_order_;
  if (feed_) feed_->forget_set_points_before(now);
}

void Controller::begin(Instant now, Outbox& out) {
  screw_.connect(bus_);
  if (feed_) feed_->connect(bus_);
  if (melt_) melt_->connect(bus_);
  if (zones_) zones_->release(!sequence_);
  state_ = ControllerState::kReady;
  if (restarted_ || joined_) {
    screw_.resume();
    if (feed_) feed_->start_from_feed();
    if (restarted_ && sequence_) static_cast<void>(sequence_->obey(now, SequenceOrder::kStart));
  }
  std::string laws;
  if (feed_) laws += ", law " + settings_.law;
  if (melt_) laws += ", melt law " + settings_.melt->law;
  out.report(
      Severity::kInfo, now, "ready",
      fmt::format("{} boards configured and started after {:.4g} s{}", settings_.boards.size(), to_s(now), laws));
}

// --- arrivals

void Controller::on_link(Instant now, LinkState link, Outbox& out) {
  if (link == link_) return;
  link_ = link;
  if (link == LinkState::kUp) {
    out.report(Severity::kInfo, now, "link-up", "the CAN link is up again");
  } else if (is_up()) {
    trip(now, "link-down", "the CAN link is down; look at cable, termination and bus-off of the interface", out);
  }
}

bool Controller::are_units_configured() const {
  return std::all_of(units_.begin(), units_.end(), [](const SerialUnit* unit) { return unit->is_configured(); });
}

void Controller::on_node(Instant now, can::ErrorState state, Outbox& out) {
  constexpr Nanos kMaxPassive = 1s;  // Who is passive for longer does not get over it by itself.
  if (state != std::exchange(node_state_, state)) {
    node_state_since_ = now;
    if (state == can::ErrorState::kActive) {
      out.report(Severity::kInfo, now, "bus-active", "the CAN controller is error-active again");
    } else if (state == can::ErrorState::kBusOff) {
      trip(now, "bus-off",
           "the CAN controller is bus-off: its frames were destroyed again and again; look at cable, "
           "termination and bit rate",
           out);
    } else {
      out.report(Severity::kWarning, now, "bus-warning", "the CAN controller is error-passive");
    }
  }
  if (state == can::ErrorState::kPassive && is_controlling() && now - node_state_since_ > kMaxPassive) {
    trip(now, "bus-passive",
         fmt::format("the CAN controller has been error-passive for {:.3g} s; look at cable, "
                     "termination and who else is on the bus",
                     to_s(kMaxPassive)),
         out);
  }
}

void Controller::on_lines(Instant now, std::span<const LinkState> lines, Outbox& out) {
  for (std::size_t i = 0; i < line_states_.size(); ++i) {
    const LinkState state = i < lines.size() ? lines[i] : LinkState::kUp;
    if (state == std::exchange(line_states_[i], state)) continue;
    if (state == LinkState::kUp) {
      out.report(Severity::kInfo, now, "line-up", fmt::format("serial line {} is up again", line_names_[i]));
    } else if (is_up()) {
      trip(now, "line-down", fmt::format("serial line {} is down; is its adapter unplugged?", line_names_[i]), out);
    }
  }
}

void Controller::on_serial(Instant now, const SerialArrival& arrival, Outbox& out) {
  if (arrival.line >= masters_.size()) return;
  masters_[arrival.line].on_bytes(now, arrival);
  handle_troubles(now, out);
}

void Controller::run_lines(Instant now, Outbox& out) {
  for (SerialMaster& master : masters_) master.on_time(now, out);
  if (!masters_.empty() && feed_) feed_->note_sent();
  handle_troubles(now, out);
}

void Controller::on_frame(Instant now, const can::CanFrame& frame, Outbox& out) {
  if (frame.extended || frame.kind != can::FrameKind::kData) return;
  if (screw_.take(frame, sync_at_)) return;
  if (feed_ && feed_->take(frame, sync_at_)) return;
  if (melt_ && melt_->take(frame, sync_at_)) return;
  if (zones_ && zones_->take(frame, now)) return;
  bus_.on_frame(now, frame, out);
  handle_troubles(now, out);
}

void Controller::handle_troubles(Instant now, Outbox& out) {
  while (auto trouble = bus_.take_trouble()) trip(now, trouble->code, std::move(trouble->text), out);
  for (SerialUnit* unit : units_) {
    while (auto trouble = unit->take_trouble()) {
      if (state_ == ControllerState::kBooting) bus_.give_up();
      trip(now, trouble->code, std::move(trouble->text), out);
    }
    if (auto news = unit->take_news()) out.report(Severity::kInfo, now, "device-back", std::move(*news));
  }
}

// --- timeline

void Controller::run_timeline(Instant now, Outbox& out) {
  if (!is_up() && state_ != ControllerState::kFault) return;
  if (feed_ && is_up() && feed_->run_set_points(now)) {
    tell_safe_flow(now, out);
    out.report(Severity::kInfo, now, "set-point",
               fmt::format("filled length to hold is now {:.4g} m", feed_->set_point_m()));
  }
  while (next_order_ < settings_.orders.size() && settings_.orders[next_order_].at <= now) {
    obey(now, settings_.orders[next_order_++], out);
  }
}

/// Boots everything anew, after somebody has looked at what was wrong.
void Controller::restart(Instant now, Outbox& out) {
  out.report(Severity::kInfo, now, "restart", fmt::format("started again from {}", text(state_)));
  state_ = ControllerState::kBooting;
  restarted_ = true;
  cycle_deadline_ = Instant::never();
  if (sequence_) sequence_.emplace(*settings_.sequence);
  bus_.start(now, out);
}

void Controller::refuse_order(Instant now, Outbox& out) const {
  const std::string where = sequence_ ? fmt::format("phase {} of the sequence, ", text(sequence_->phase())) : "";
  out.report(Severity::kWarning, now, "order-refused",
             fmt::format("order comes in {}state {}: it means nothing there", where, text(state_)));
}

void Controller::obey(Instant now, const Order& order, Outbox& out) {
  const bool starts = order.kind == Order::Kind::kSequence && order.order == SequenceOrder::kStart;
  if (starts && (state_ == ControllerState::kSafe || state_ == ControllerState::kFault)) return restart(now, out);
  if (!is_up()) return refuse_order(now, out);
  switch (order.kind) {
    case Order::Kind::kFrontSetPoint:
      melt_->set_front(order.value);
      return out.report(Severity::kInfo, now, "front-set-point",
                        fmt::format("melting front to hold is now {:.4g} m", order.value));
    case Order::Kind::kScrewSpeed:
      run_rev_per_s_ = order.value;
      out.report(Severity::kInfo, now, "screw-speed",
                 fmt::format("screw goes to {:.4g} rpm", order.value * kSecondsPerMinute));
      if (!sequence_) screw_.set_target(run_rev_per_s_);
      break;
    case Order::Kind::kZoneSetPoint:
      zones_->set_barrel(order.value);
      return out.report(Severity::kInfo, now, "zone-set-point", fmt::format("barrel goes to {:.4g} C", order.value));
    case Order::Kind::kAutotune:
      return zones_->tuning().ask(order.index);
    case Order::Kind::kMaterial: {
      const MaterialSettings& material = settings_.materials[order.index];
      melt_->set_material(material);
      if (feed_) feed_->set_material(material);
      if (zones_) zones_->set_barrel(material.T_barrel_degC);
      return out.report(Severity::kInfo, now, "material",
                        fmt::format("{}: barrel goes to {:.4g} C, melting front to {:.4g} m", material.name,
                                    material.T_barrel_degC, material.front_set_m));
    }
    case Order::Kind::kSequence:
      if (!is_controlling() || !sequence_ || !sequence_->obey(now, order.order)) {
        refuse_order(now, out);
      } else {
        out.report(Severity::kInfo, now, "sequence", fmt::format("now {}", text(sequence_->phase())));
      }
      break;
  }
  update_safe_flow(now, out);
}

void Controller::update_safe_flow(Instant now, Outbox& out) {
  if (!feed_) return;
  const SequenceDemand wanted = demand();
  if (feed_->set_safe(wanted.screw_rev_per_s * settings_.pitch_m, wanted.feed != FeedMode::kNone)) {
    tell_safe_flow(now, out);
  }
}

void Controller::tell_safe_flow(Instant now, Outbox& out) {
  feed_->tell_safe_flow(now, bus_, out);
}

// --- the cycle

bool Controller::has_all_samples() const {
  return screw_.is_complete() && (!feed_ || feed_->is_complete()) && (!melt_ || melt_->is_complete());
}

void Controller::close_cycle_if_due(Instant now, Outbox& out) {
  if (cycle_deadline_ == Instant::never()) return;
  if (now < cycle_deadline_ && !has_all_samples()) return;
  cycle_deadline_ = Instant::never();
  hand_over_samples();
  if (state_ == ControllerState::kSafe) {
    repeat_safe(now, out);
  } else {
    control(now, out);
  }
  if (feed_) feed_->end_cycle(now);
}

void Controller::hand_over_samples() {
  const std::optional<ScrewSample> screw = screw_.close_cycle();
  if (!screw) ++samples_missed_;
  if (feed_) samples_missed_ += feed_->close_cycle(screw);
  if (melt_) {
    samples_missed_ += melt_->close_cycle(screw_.speed_m_per_s(), zones_ ? zones_->T_barrel_degC() : std::nullopt,
                                          find_coldest_at_melt());
  }
}

/// Of the zones behind the front and the melt's thermometer; what the boards report, not what was asked of them.
std::optional<double> Controller::find_coldest_at_melt() const {
  std::optional<double> coldest;
  if (zones_) coldest = zones_->T_coldest_beyond_degC(melt_->loop().front_m() / settings_.melt->model.length_m);
  if (const auto T_melt = feed_ ? feed_->T_melt_degC() : std::nullopt)
    coldest = std::min(coldest.value_or(*T_melt), *T_melt);
  return coldest;
}

SequenceDemand Controller::demand() const {
  if (sequence_) return sequence_->demand(run_rev_per_s_);
  return {.heat = true, .screw_rev_per_s = run_rev_per_s_, .feed = FeedMode::kLaw};
}

bool Controller::are_loops_ready() const {
  return (!feed_ || feed_->is_ready()) && (!melt_ || melt_->is_ready());
}

bool Controller::are_loops_good() const {
  return (!feed_ || feed_->is_measured_well()) && (!melt_ || melt_->is_measured_well());
}

void Controller::control(Instant now, Outbox& out) {
  if (auto trouble = judge(now)) return trip(now, trouble->code, std::move(trouble->text), out);
  if (sequence_) {
    run_sequence(now, out);
  } else if (state_ == ControllerState::kReady && !are_loops_ready()) {
    if (zones_) zones_->tell(now, out);
    return;
  }
  if (state_ == ControllerState::kReady && (!sequence_ || sequence_->phase() != SequencePhase::kCold)) {
    state_ = ControllerState::kRunning;
    std::string what;
    if (!sequence_ && feed_) what += fmt::format("filled length {:.4f} m", feed_->loop().x_m());
    if (!sequence_ && melt_) {
      what += fmt::format("{}melting front {:.4f} m", what.empty() ? "" : ", ", melt_->loop().front_m());
    }
    out.report(Severity::kInfo, now, "running", what.empty() ? "the sequence has begun" : std::move(what));
  }
  if (state_ != ControllerState::kReady) {
    const bool holds = sequence_ && sequence_->phase() == SequencePhase::kHolding;
    state_ = holds ? ControllerState::kHolding : ControllerState::kRunning;
  }
  control_feed(now, out);
  if (is_controlling()) control_melt(now, out);
  if (!is_controlling()) return;
  if (zones_) {
    zones_->tell(now, out);
    if (zones_->serial().empty()) zones_->tuning().update(now, bus_.boot(config::BoardKind::kHeater), out);
  }
  screw_.drive(out);
  reaction_s_ = to_s(now - sync_at_);
}

std::optional<Trouble> Controller::judge(Instant now) {
  if (feed_) {
    safety::Observation seen = feed_->observe(now, bus_.ready_at());
    if (const auto since = screw_.wrong_since()) seen.wrong_speed_time = now - *since;
    if (demand().feed != FeedMode::kLaw) {
      // A screw that stands or fills has no pressure to measure.
      seen.implausible_time = {};
      seen.pressure_age = {};
      seen.disagreement_time = {};
      seen.filled_length_m.reset();
    }
    const safety::Trip why = safety::judge(settings_.limits, seen);
    if (why != safety::Trip::kNone) {
      return Trouble{safety::code_of(why), safety::describe(why, settings_.limits, seen)};
    }
  } else {
    safety::Observation seen;
    seen.screw_age = now - std::max(screw_.measured_at(), bus_.ready_at());
    if (const auto since = screw_.wrong_since()) seen.wrong_speed_time = now - *since;
    const safety::Trip why = safety::judge(settings_.limits, seen);
    if (why != safety::Trip::kNone) {
      return Trouble{safety::code_of(why), safety::describe(why, settings_.limits, seen)};
    }
  }
  if (melt_ && !sequence_ && !melt_->is_ready() && now - bus_.ready_at() > settings_.limits.max_age) {
    return Trouble{"front-not-measured", fmt::format("no front, no inlet temperature or no turning screw within "
                                                     "{:.3g} s; look at the camera's lens and at the drive",
                                                     to_s(settings_.limits.max_age))};
  }
  if (zones_) return zones_->judge(now, bus_.ready_at());
  return {};
}

void Controller::run_sequence(Instant now, Outbox& out) {
  const bool changed = sequence_->update(now, !zones_ || zones_->is_warm(), are_loops_good());
  if (changed) out.report(Severity::kInfo, now, "sequence", fmt::format("now {}", text(sequence_->phase())));
  if (sequence_->is_overdue(now)) {
    return trip(now, "sequence-overdue",
                fmt::format("{} for {:.0f} s; look at the zones that are not warm, or at camera and pressure",
                            text(sequence_->phase()), to_s(now - sequence_->since())),
                out);
  }
  const SequenceDemand wanted = demand();
  if (zones_) zones_->release(wanted.heat);
  screw_.set_target(wanted.screw_rev_per_s);
  if (feed_ && changed && sequence_->phase() == SequencePhase::kFilling) feed_->start_empty();  // The screw has stood.
  update_safe_flow(now, out);
}

void Controller::control_feed(Instant now, Outbox& out) {
  if (!feed_ || !is_controlling()) return;
  const FeedMode mode = demand().feed;
  if (mode != FeedMode::kLaw) return feed_->feed(mode, now, out);
  if (auto trouble = feed_->control(sync_at_, now, out)) trip(now, trouble->code, std::move(trouble->text), out);
}

void Controller::control_melt(Instant now, Outbox& out) {
  if (!melt_) return;
  // Also while a screw that is to stand runs down: what is left in the barrel must not stick.
  const bool turns = demand().screw_rev_per_s > 0.0 || screw_.demand_rev_per_s() > kSlowestShare * run_rev_per_s_;
  if (!turns || !(melt_->loop().is_running() || melt_->is_ready())) return melt_->rest(out);
  if (auto trouble = melt_->control(sync_at_, out)) trip(now, trouble->code, std::move(trouble->text), out);
}

// --- doubt

void Controller::repeat_safe(Instant now, Outbox& out) {
  if (feed_) feed_->go_safe(now, out);
  if (melt_) melt_->rest(out);
  if (zones_) zones_->tell(now, out);
}

std::string Controller::describe_safe() const {
  std::string what;
  if (feed_) what += fmt::format("; feed goes to {:.4g} kg/h", feed_->safe_flow_kg_per_s() * kSecondsPerHour);
  if (melt_) what += "; inlet flux off";
  if (zones_) what += "; heaters off";
  what += settings_.safe_screw == SafeScrew::kStop ? ", the screw stops" : ", the screw turns on";
  return what;
}

void Controller::trip(Instant now, std::string_view code, std::string reason, Outbox& out) {
  const bool was_controlling = is_controlling();
  if (state_ == ControllerState::kBooting) {
    state_ = ControllerState::kFault;
    reason += "; no board is started";
  } else if (was_controlling) {
    state_ = ControllerState::kSafe;
    reason += describe_safe();
  }
  out.report(Severity::kFault, now, std::string{code}, std::move(reason));
  if (!was_controlling) return;
  if (zones_) zones_->release(false);
  repeat_safe(now, out);
  if (settings_.safe_screw == SafeScrew::kStop) screw_.quick_stop(out);
}

bool Controller::is_up() const {
  return is_controlling() || state_ == ControllerState::kSafe;
}

bool Controller::is_controlling() const {
  return state_ == ControllerState::kReady || state_ == ControllerState::kRunning ||
         state_ == ControllerState::kHolding;
}

// --- the recording

void Controller::make_signals() {
  constexpr SignalKind kError = SignalKind::kErrorCounter;
  if (feed_) {
    for (const char* name :
         {"x_m", "P_m", "U_command", "U_applied", "set_point_m", "flow_command_kg_per_h", "pressure_Pa"}) {
      signals_.push_back({fmt::format("controller.{}", name)});
    }
  }
  signals_.push_back({"controller.speed_m_per_s"});
  if (feed_) signals_.push_back({"controller.measurement_age_s"});
  signals_.push_back({"controller.reaction_s"});
  signals_.push_back({"controller.state"});
  if (sequence_) signals_.push_back({"controller.sequence"});
  if (melt_) {
    for (const char* name :
         {"front_m", "front_set_m", "T_ref_degC", "q_f_star_W_per_m2", "q_f_W_per_m2", "melt_Z_W_per_m2",
          "T_inlet_degC", "T_inlet_estimate_degC", "T_barrel_degC", "solid_margin_K", "liquid_margin_K", "trim_K",
          "gain_speed_m_per_s", "front_coasted_m", "inlet_coasted_m"}) {
      signals_.push_back({fmt::format("controller.{}", name)});
    }
    for (std::size_t i = 0; i < MeltLoop::kProfilePoints; ++i)
      signals_.push_back({fmt::format("controller.T_{:02}_degC", i)});
  }
  for (std::size_t i = 0; zones_ && i < zones_->zone_count(); ++i) {
    const std::size_t channel = zones_->channel(i);
    const std::string zone = channel == kNozzleChannel ? "nozzle" : fmt::format("zone{}", channel);
    signals_.push_back({fmt::format("controller.{}_set_degC", zone)});
    signals_.push_back({fmt::format("controller.{}_degC", zone)});
    signals_.push_back({fmt::format("controller.{}_output", zone)});
  }
  for (const char* name : {"sdo_timeouts", "heartbeats_lost", "tpdos_missed", "emcys", "syncs_missed"}) {
    signals_.push_back({fmt::format("controller.{}", name), kError});
  }
  for (const std::string& line : line_names_) {
    signals_.push_back({fmt::format("controller.{}_timeouts", line), kError});
  }
}

void Controller::read_signals(std::span<double> values) const {
  std::size_t next = 0;
  const auto put = [&](double value) { values[next++] = value; };
  if (feed_) {
    const LengthLoop& loop = feed_->loop();
    put(loop.x_m());
    put(feed_->command().P_m);
    put(feed_->command().U);
    put(loop.U_applied());
    put(feed_->set_point_m());
    put(feed_->command().flow_kg_per_s * kSecondsPerHour);
    put(loop.pressure_Pa());
  }
  put(screw_.speed_m_per_s());
  if (feed_) put(feed_->loop().has_estimate() ? to_s(sync_at_ - feed_->loop().measured_at()) : 0.0);
  put(reaction_s_);
  put(static_cast<double>(state_));
  if (sequence_) put(static_cast<double>(sequence_->phase()));
  if (melt_) {
    const MeltLoop& loop = melt_->loop();
    const safety::MeltObservation seen = loop.observe();
    put(loop.front_m());
    put(loop.front_set_m());
    put(loop.request().T_reference_degC);
    put(loop.reference_flux_W_per_m2());
    put(loop.request().feedforward_W_per_m2);
    put(loop.request().Z_W_per_m2);
    put(loop.T_inlet_degC());
    put(loop.T_inlet_estimate_degC());
    put(loop.T_barrel_degC());
    put(loop.solid_margin_K());
    put(loop.liquid_margin_K());
    put(loop.trim_K());
    put(loop.gain_speed_m_per_s());
    put(seen.front_coasted_m);
    put(seen.inlet_coasted_m);
    for (const double T_degC : loop.profile_degC()) put(T_degC);
  }
  for (std::size_t i = 0; zones_ && i < zones_->zone_count(); ++i) {
    put(zones_->set_degC(i));
    put(zones_->T_degC(i));
    put(zones_->output(i));
  }
  put(static_cast<double>(bus_.sdo_timeouts()));
  put(static_cast<double>(bus_.heartbeats_lost()));
  put(static_cast<double>(samples_missed_));
  put(static_cast<double>(bus_.emcys()));
  put(static_cast<double>(bus_.syncs_missed()));
  for (const SerialMaster& master : masters_) put(static_cast<double>(master.timeouts()));
}

}  // namespace meltbench::machine
