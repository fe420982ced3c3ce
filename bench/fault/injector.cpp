#include "bench/fault/injector.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <utility>

#include "bench/bus/bit_timed_medium.hpp"
#include "bench/bus/run_observer.hpp"
#include "protocols/participant/restartable.hpp"

namespace meltbench::fault {

namespace {

/// SplitMix64's finisher: a bijection that spreads neighbouring inputs over all 64 bits.
std::uint64_t mix(std::uint64_t x) {
  x = (x ^ (x >> 30U)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27U)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31U);
}

/// In [0, 1), a function of both numbers alone.
double draw(std::uint64_t seed, std::uint64_t number) {
  return static_cast<double>(mix(seed ^ mix(number + 1)) >> 11U) * 0x1p-53;
}

Nanos nanos_from_ms(double ms) {
  return nanos_from_s(ms * 1e-3);
}

bool is_order(const Fault& fault) {
  return (fault.target == Target::kBoard && fault.kind() != Kind::kSameNodeId) || fault.target == Target::kSensor ||
         fault.target == Target::kActuator || fault.target == Target::kPlant;
}

bool is_of_program(Target target) {
  return target == Target::kClock || target == Target::kProgram;
}

bool is_moment(Kind kind) {
  return kind == Kind::kReboot || kind == Kind::kStep || kind == Kind::kRestart;
}

bool holds(const Trigger& trigger, double value) {
  return (!trigger.above || value > *trigger.above) && (!trigger.below || value < *trigger.below);
}

}  // namespace

Injector::Injector(std::vector<Fault> faults, const Setup& setup)
    : seed_{setup.seed},
      signals_{setup.signals.begin(), setup.signals.end()},
      participants_{setup.participants.begin(), setup.participants.end()},
      emulator_{setup.emulator},
      report_{setup.report},
      programs_(setup.participants.size()),
      wires_{setup.emulator, setup.emulator_lines} {
  for (Fault& fault : faults) plan(std::move(fault));
  update_deadline();
}

void Injector::plan(Fault fault) {
  Planned planned;
  planned.seed = mix(seed_ ^ mix(fault.seed ^ mix(faults_.size())));
  if (fault.trigger.on == Trigger::On::kTime) planned.due = fault.trigger.at;
  if (fault.trigger.on == Trigger::On::kSignal) {
    const auto found = std::find_if(signals_.begin(), signals_.end(),
                                    [&](const SignalInfo& signal) { return signal.name == fault.trigger.signal; });
    if (found == signals_.end()) {
      throw config::ConfigError{fault.table.origin,
                                fmt::format("fault.when.signal: there is no \"{}\"", fault.trigger.signal),
                                "meltbench list --signals SCENARIO prints those of a run"};
    }
    planned.signal = static_cast<std::size_t>(found - signals_.begin());
  }
  if (fault.kind() == Kind::kSameNodeId) planned.twin = std::make_unique<Twin>(fault);
  planned.fault = std::move(fault);
  faults_.push_back(std::move(planned));
}

void Injector::add(Fault fault, Instant now) {
  const auto write = [&fault](std::string_view key, Instant at) { fault.table.set(key, config::Value{to_s(at), {}}); };
  Trigger& trigger = fault.trigger;
  if (trigger.on != Trigger::On::kTime) {
    trigger.armed_at = std::max(trigger.armed_at, now);
    write("armed_at_s", trigger.armed_at);
  } else if (fault.table.find("at_s") == nullptr) {
    trigger.at = now;
    write("at_s", now);
  } else if (trigger.at < now) {
    throw config::ConfigError{fault.table.find("at_s")->value.origin,
                              fmt::format("fault.at_s = {}, is over: the run is at {} s", to_s(trigger.at), to_s(now)),
                              "leave at_s away: it then begins at once"};
  }
  plan(std::move(fault));
  update_deadline();
}

std::size_t Injector::clear(std::string_view name, Instant now) {
  std::size_t count = 0;
  for (Planned& planned : faults_) {
    Fault& fault = planned.fault;
    if (planned.phase == Phase::kOver || fault.name != name) continue;
    fault.cleared_at = std::min(fault.cleared_at.value_or(now), now);
    fault.table.set("cleared_at_s", config::Value{to_s(*fault.cleared_at), {}});
    ++count;
  }
  update_deadline();
  return count;
}

config::Array Injector::write() const {
  config::Array faults;
  for (const Planned& planned : faults_) faults.push_back({planned.fault.table, {}});
  return faults;
}

std::vector<Injector::Standing> Injector::standing() const {
  std::vector<Standing> standing;
  for (const Planned& planned : faults_) {
    if (planned.phase == Phase::kOver) continue;
    const Instant cleared = planned.fault.cleared_at.value_or(Instant::never());
    const bool is_on = planned.phase == Phase::kOn;
    standing.push_back({planned.fault.name, is_on, is_on ? std::min(planned.due, cleared) : planned.due});
  }
  return standing;
}

void Injector::update_deadline() {
  deadline_ = Instant::never();
  for (const Planned& planned : faults_) {
    if (planned.phase != Phase::kOver) {
      deadline_ = std::min({deadline_, planned.due, planned.fault.cleared_at.value_or(Instant::never())});
    }
    if (planned.twin) deadline_ = std::min(deadline_, planned.twin->next_deadline());
  }
  for (const Held& held : held_) deadline_ = std::min(deadline_, held.due);
}

void Injector::tell(Instant now, std::string_view code, const Planned& planned, std::string_view more) const {
  report_({now, Severity::kInfo, std::string{code}, fmt::format("{}{}", planned.fault.name, more)});
}

void Injector::begin(std::size_t number, Instant now, bus::RunControl& run) {
  Planned& planned = faults_[number];
  const Fault& fault = planned.fault;
  planned.phase = Phase::kOn;
  planned.due = fault.duration ? now + *fault.duration : Instant::never();
  tell(now, "fault-on", planned, "");
  if (is_order(fault)) run.post_order(emulator_, write_order(number, true, fault));
  if (planned.twin) plug_twin(planned, true, now, run);
  if (is_of_program(fault.target)) begin_program(fault, now, run);
  wires_.begin(number, fault, planned.seed, now, run);
  if (fault.kind() == Kind::kCorrupt) planned.on_wire = flip_on_wire(number, now, run);
  if (is_moment(fault.kind())) planned.phase = Phase::kOver;
}

std::size_t Injector::find_participant(std::string_view name) const {
  return static_cast<std::size_t>(std::find(participants_.begin(), participants_.end(), name) - participants_.begin());
}

void Injector::begin_program(const Fault& fault, Instant now, bus::RunControl& run) {
  const std::size_t number = find_participant(fault.object);
  ProgramCondition& program = programs_[number];
  if (fault.kind() == Kind::kDrift) program.clock.set_drift(now, fault.value("drift_ppm"));
  if (fault.kind() == Kind::kStep) program.clock.step(now, nanos_from_ms(fault.value("step_ms")));
  if (fault.kind() == Kind::kKilled) ++program.kills;
  if (fault.kind() == Kind::kRestart) run.post_order(number, std::string{Restartable::kOrder});
}

void Injector::end_program(const Fault& fault, Instant now, bus::RunControl& run) {
  const std::size_t number = find_participant(fault.object);
  ProgramCondition& program = programs_[number];
  if (fault.kind() == Kind::kDrift) program.clock.set_drift(now, 0.0);
  if (fault.kind() == Kind::kKilled && --program.kills == 0) run.post_order(number, std::string{Restartable::kOrder});
}

/// Where frames have bits, they are corrupted there: an error frame, and the sender repeats.
bool Injector::flip_on_wire(std::size_t number, Instant now, bus::RunControl& run) const {
  bus::BitTimedMedium* medium = run.medium();
  if (medium == nullptr) return false;
  constexpr std::size_t kBit = 20;  // Behind the identifier: it disturbs no arbitration.
  const Planned& planned = faults_[number];
  const Fault& fault = planned.fault;
  const bool without_end = fault.duration || fault.probability < 1.0;
  const std::uint64_t most = without_end ? std::numeric_limits<std::uint64_t>::max() : 1;
  medium->bus().flip(now, {.id = fault.frames.id,
                           .mask = fault.frames.mask,
                           .bit = kBit,
                           .frames = fault.count.value_or(most),
                           .probability = fault.probability,
                           .seed = planned.seed,
                           .number = number + 1});
  return true;
}

void Injector::end(std::size_t number, Instant now, bus::RunControl& run) {
  Planned& planned = faults_[number];
  const Fault& fault = planned.fault;
  planned.phase = Phase::kOver;
  wires_.end(number, fault, now, run);
  if (planned.on_wire && run.medium() != nullptr) run.medium()->bus().end_flips(now, number + 1);
  if (is_order(fault)) run.post_order(emulator_, write_order(number, false, fault));
  if (planned.twin) plug_twin(planned, false, now, run);
  if (is_of_program(fault.target)) end_program(fault, now, run);
  tell(now, "fault-off", planned,
       fault.target == Target::kFrame && !planned.on_wire
           ? fmt::format(": hit {} of {} frames", planned.hits, planned.matched)
           : "");
}

/// A fault that is cleared is over, or ends now.
void Injector::obey_clearing(Planned& planned, Instant now) const {
  if (planned.phase == Phase::kOver || planned.fault.cleared_at.value_or(Instant::never()) > now) return;
  if (planned.phase == Phase::kWaiting) planned.phase = Phase::kOver;
  planned.due = now;
}

void Injector::on_time(Instant now, bus::RunControl& run) {
  for (std::size_t number = 0; number < faults_.size(); ++number) {
    obey_clearing(faults_[number], now);
    if (faults_[number].due > now) continue;
    if (faults_[number].phase == Phase::kWaiting) begin(number, now, run);
    if (faults_[number].phase == Phase::kOn && faults_[number].due <= now) end(number, now, run);
  }
  run_twins(now, run);
  release_held(now, run);
  update_deadline();
}

void Injector::plug_twin(Planned& planned, bool in, Instant now, bus::RunControl& run) {
  if (in) {
    planned.twin->plug_in(now, from_twins_);
  } else {
    planned.twin->unplug();
  }
  if (bus::BitTimedMedium* medium = run.medium()) {
    medium->plug_twin(now, std::any_of(faults_.begin(), faults_.end(),
                                       [](const Planned& one) { return one.twin && one.twin->is_in(); }));
  }
  send_for_twins(now, run);
}

void Injector::run_twins(Instant now, bus::RunControl& run) {
  for (Planned& planned : faults_) {
    if (planned.twin && planned.twin->next_deadline() <= now) planned.twin->on_time(now, from_twins_);
  }
  send_for_twins(now, run);
}

void Injector::tell_twins(const can::StampedFrame& stamped, std::size_t sender, bus::RunControl& run) {
  if (sender == bus::kOutsideSender || stamped.frame.kind == can::FrameKind::kError) return;  // Its own words.
  if (bus::BitTimedMedium* medium = run.medium(); medium != nullptr && !medium->hears_twin()) return;
  for (Planned& planned : faults_) {
    if (planned.twin && planned.twin->is_in()) planned.twin->on_frame(stamped.at, stamped.frame, from_twins_);
  }
  send_for_twins(stamped.at, run);
}

/// On the ideal bus what twins say comes right behind the frame that they answer.
void Injector::send_for_twins(Instant now, bus::RunControl& run) {
  bus::BitTimedMedium* medium = run.medium();
  for (const can::CanFrame& frame : from_twins_) {
    if (medium != nullptr) {
      medium->send_for_twin(now, frame);
    } else {
      held_.push_back({now, 0, bus::kOutsideSender, frame});
    }
  }
  from_twins_.clear();
}

void Injector::release_held(Instant now, bus::RunControl& run) {
  for (std::size_t i = 0; i < held_.size();) {
    if (held_[i].due > now) {
      ++i;
      continue;
    }
    const Held held = held_[i];
    held_.erase(held_.begin() + static_cast<std::ptrdiff_t>(i));
    run.deliver(held.frame, held.sender);
  }
}

bool Injector::on_frame(const can::StampedFrame& stamped, std::size_t sender, bus::RunControl& run) {
  if (faults_.empty()) return true;
  const auto& [now, frame] = stamped;
  release_held(now, run);  // What comes behind the frame before this one.
  bool goes_on = true;
  for (std::size_t number = 0; number < faults_.size(); ++number) {
    Planned& planned = faults_[number];
    const Trigger& trigger = planned.fault.trigger;
    if (planned.phase == Phase::kWaiting && trigger.on == Trigger::On::kFrame && now >= trigger.armed_at &&
        trigger.frame.matches(frame) && ++planned.seen >= trigger.nth) {
      begin(number, now, run);
    }
    if (planned.phase != Phase::kOn || planned.fault.target != Target::kFrame || planned.on_wire) continue;
    if (!hits(planned, frame)) continue;
    goes_on = apply(planned, stamped, sender);
    if (planned.fault.count && planned.hits >= *planned.fault.count) end(number, now, run);
    if (!goes_on) break;
  }
  if (goes_on) {
    pass_held(now);
    tell_twins(stamped, sender, run);
  }
  update_deadline();
  return goes_on;
}

bool Injector::hits(Planned& planned, const can::CanFrame& frame) const {
  if (!planned.fault.frames.matches(frame)) return false;
  const std::uint64_t number = planned.matched++;
  if (draw(planned.seed, number) >= planned.fault.probability) return false;
  ++planned.hits;
  return true;
}

bool Injector::apply(Planned& planned, const can::StampedFrame& stamped, std::size_t sender) {
  const Fault& fault = planned.fault;
  const auto hold = [&](Nanos span, std::size_t behind) {
    held_.push_back({stamped.at + span, behind, sender, stamped.frame});
  };
  switch (fault.kind()) {
    case Kind::kDelay: {
      const double share = draw(~planned.seed, planned.hits);
      hold(nanos_from_ms(fault.value("delay_ms") + share * fault.value("jitter_ms")), 0);
      return false;
    }
    case Kind::kDuplicate:
      for (int i = 0; i < static_cast<int>(fault.value("copies")); ++i) hold(nanos_from_ms(fault.value("delay_ms")), 0);
      return true;
    case Kind::kReorder:
      hold(nanos_from_ms(fault.value("hold_ms")), static_cast<std::size_t>(fault.value("behind")));
      return false;
    default:  // kDrop; kCorrupt: every receiver finds the CRC wrong.
      return false;
  }
}

/// A frame has passed those that are to come behind it.
void Injector::pass_held(Instant now) {
  for (Held& held : held_) {
    if (held.behind > 0 && --held.behind == 0) held.due = now;
  }
}

void Injector::on_row(Instant at, std::span<const double> values) {
  bool any = false;
  for (Planned& planned : faults_) {
    if (planned.phase != Phase::kWaiting || planned.fault.trigger.on != Trigger::On::kSignal) continue;
    if (at < planned.fault.trigger.armed_at) continue;
    if (planned.due != Instant::never() || !holds(planned.fault.trigger, values[planned.signal])) continue;
    planned.due = at;
    any = true;
  }
  if (any) update_deadline();
}

}  // namespace meltbench::fault
