#include "bench/cli/live_faults.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <memory>
#include <system_error>
#include <utility>

#include "bench/cli/repro_file.hpp"

namespace meltbench::cli {
namespace {

using Clock = std::chrono::steady_clock;
using runtime::Question;

constexpr auto kLookPeriod = 5ms;  // Of wall-clock time: soon enough for a user, and nothing beside a run.

std::string describe(const fault::Injector::Standing& standing) {
  const bool is_known = standing.due < Instant::never();
  if (standing.is_on) return is_known ? fmt::format("until {} s", to_s(standing.due)) : "until it is cleared";
  return is_known ? fmt::format("at {} s", to_s(standing.due)) : "waits for its trigger";
}

/// Whether a fault of this target and kind would be taken now.
bool can_happen(const std::string& target, const fault::KindInfo& info, const FaultLimits& limits) {
  if (info.kind == fault::Kind::kColdStart) return false;  // Acts before a run.
  fault::Fault fault;
  fault.target = info.target;
  fault.object = target.substr(std::min(target.find('.'), target.size() - 1) + 1);
  fault.info = &info;
  fault.table.set("target", config::Value{target, {}});
  fault.table.set("kind", config::Value{std::string{info.name}, {}});
  try {
    require_possible(fault, limits);
    return true;
  } catch (const config::ConfigError&) {
    return false;
  }
}

}  // namespace

LiveFaults::LiveFaults(fault::Injector& injector, bus::Broker& broker, PreparedRun& prepared, FaultLimits limits,
                       bus::RunObserver& observer)
    : injector_{injector},
      broker_{broker},
      prepared_{prepared},
      limits_{std::move(limits)},
      scope_{fault::make_scope(prepared.run.root, prepared.run.rig)},
      observer_{observer} {}

bool LiveFaults::look(Instant now) {
  if (Clock::now() < next_look_) return false;
  next_look_ = Clock::now() + kLookPeriod;
  bool any = false;
  while (auto asked = broker_.take_question()) {
    bus::answer(*asked, reply(asked->question, now));
    any = true;
  }
  return any;
}

runtime::Answer LiveFaults::reply(const Question& question, Instant now) {
  try {
    if (question.about == Question::About::kBeginFault) return {true, begin(question.text, now)};
    if (question.about == Question::About::kClearFault) return clear(question.text, now);
    return {true, list(now)};
  } catch (const config::ConfigError& error) {
    return {false, error.what(), error.hint()};
  } catch (const std::system_error& error) {
    return {false, fmt::format("the run goes on with it, but it cannot be repeated: {}", error.what())};
  }
}

std::string LiveFaults::begin(const std::string& text, Instant now) {
  fault::Fault fault = fault::read_live_fault(text, scope_);
  require_possible(fault, limits_);
  const std::string name = fault.name;
  const fault::Trigger trigger = fault.trigger;
  const bool begins_now = trigger.on == fault::Trigger::On::kTime && trigger.at <= now;
  injector_.add(std::move(fault), now);
  keep(now, "fault-given", name);
  if (begins_now) return fmt::format("{} begins at {} s", name, to_s(now));
  if (trigger.on == fault::Trigger::On::kTime) return fmt::format("{} will begin at {} s", name, to_s(trigger.at));
  return fmt::format("{} waits for its trigger from {} s on", name, to_s(now));
}

runtime::Answer LiveFaults::clear(const std::string& name, Instant now) {
  if (injector_.clear(name, now) > 0) {
    keep(now, "fault-cleared", name);
    return {true, fmt::format("{} ends at {} s", name, to_s(now))};
  }
  std::vector<std::string_view> names;
  for (const auto& standing : injector_.standing()) names.push_back(standing.name);
  return {false, fmt::format("no fault named \"{}\" is on or to come", name),
          names.empty() ? "there is none" : fmt::format("there are: {}", fmt::join(names, ", "))};
}

std::string LiveFaults::list(Instant now) const {
  std::string text = fmt::format("{}, {:.3f} s of {} s, {}\n", prepared_.run.label(), to_s(now),
                                 to_s(prepared_.run.duration), prepared_.folder.string());
  for (const auto& standing : injector_.standing()) {
    text += fmt::format("  {:<8}{}, {}\n", standing.is_on ? "on" : "to come", standing.name, describe(standing));
  }
  text += "what can fail, and how:";
  for (const std::string& target : fault::list_targets(scope_)) {
    std::vector<std::string_view> kinds;
    for (const fault::KindInfo* info : fault::list_kinds(target, scope_)) {
      if (can_happen(target, *info, limits_)) kinds.push_back(info->name);
    }
    if (!kinds.empty()) text += fmt::format("\n  {:<26}{}", target, fmt::join(kinds, ", "));
  }
  return text;
}

/// Into the recording, and into the file that repeats the run.
void LiveFaults::keep(Instant now, std::string_view code, const std::string& text) {
  observer_.on_event(bus::kOutsideSender, {now, Severity::kInfo, std::string{code}, text + ": while the run went on"});
  auto root = std::make_shared<config::Table>(prepared_.run.root.table());
  root->set("fault", config::Value{injector_.write(), {}});
  prepared_.run.root = config::Section{std::move(root)};
  write_repro_file(prepared_);
}

}  // namespace meltbench::cli
