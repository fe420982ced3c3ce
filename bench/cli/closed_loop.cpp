#include "bench/cli/closed_loop.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "bench/cli/memory_run.hpp"
#include "bench/decode/story.hpp"

namespace meltbench::cli {
namespace {

using config::Array;
using config::Table;
using config::Value;

template <typename T>
void set(Table& table, std::string_view key, T value) {
  table.set(key, Value{std::move(value), {}});
}

const std::string& text_of(const Table& fault, std::string_view key) {
  return std::get<std::string>(fault.find(key)->value.data);
}

/// Listens to a run's bus as to a log.
class Listener final : public bus::RunObserver {
 public:
  Listener(const config::Rig& rig, std::vector<SignalInfo> signals)
      : story_{rig}, traces_{rig}, signals_{std::move(signals)} {}

  void on_frame(const can::StampedFrame& frame, std::size_t /*sender*/) override {
    // A log has microseconds.
    const Instant at{std::chrono::floor<std::chrono::microseconds>(frame.at.since_start)};
    story_.take(at, frame.frame);
    traces_.take(at, frame.frame);
  }
  void on_event(std::size_t participant, const Event& event) override {
    if (event.severity == Severity::kInfo) return;
    constexpr std::array<std::string_view, 2> kSources{"controller", "plant"};
    complain(fmt::format("{}.{}", participant < kSources.size() ? kSources.at(participant) : "bench", event.code));
  }
  void on_row(Instant /*at*/, std::span<const double> values) override { last_.assign(values.begin(), values.end()); }

  [[nodiscard]] ClosedLoopResult finish(const config::Rig& rig) {
    story_.finish();
    for (std::size_t i = 0; i < last_.size(); ++i) {
      if (signals_[i].kind == SignalKind::kErrorCounter && last_[i] != 0.0) complain(signals_[i].name);
    }
    return {decode::list_reactions(story_.findings(), story_.end(), rig), std::move(traces_), std::move(complaints_)};
  }

 private:
  void complain(std::string what) {
    if (std::ranges::find(complaints_, what) == complaints_.end()) complaints_.push_back(std::move(what));
  }

  decode::Story story_;
  decode::Traces traces_;
  std::vector<SignalInfo> signals_;
  std::vector<double> last_;
  std::vector<std::string> complaints_;
};

/// The tree of a run without what a log replaces. Events behind the end cannot happen.
Table make_tree(const scenario::ResolvedRun& run, Instant end) {
  Table tree;
  for (const config::Entry& entry : run.root.table().entries()) {
    constexpr std::array<std::string_view, 5> kReplaced{"event", "fault", "check", "health", "variant"};
    if (std::ranges::find(kReplaced, entry.key) == kReplaced.end()) tree.set(entry);
  }
  Array events;
  for (const config::TimelineEvent& event : run.events) {
    if (event.at < end) events.push_back(Value{event.section.table(), {}});
  }
  if (!events.empty()) set(tree, "event", std::move(events));
  return tree;
}

}  // namespace

ClosedLoop::ClosedLoop(scenario::ResolvedRun settings, Instant end)
    : settings_{std::move(settings)}, end_{end}, tree_{make_tree(settings_, end)} {}

bool ClosedLoop::is_possible() const {
  return !settings_.rig.controller_is_external && !settings_.rig.has_real_board() && end_ > Instant{};
}

Table make_bus(const decode::Extraction& found, const config::RigBus& bus) {
  Table keys;
  const bool is_bit_timed = bus.fidelity == config::BusFidelity::kBitTimed;
  if (found.needs_bit_timed && !is_bit_timed) {
    set(keys, "fidelity", std::string{"bit-timed"});
    if (found.restart_after && !bus.restart_after) set(keys, "restart_ms", to_s(*found.restart_after) * 1e3);
  }
  if (found.needs_ideal && is_bit_timed) set(keys, "fidelity", std::string{"ideal"});
  return keys;
}

void ClosedLoop::take_bus(const decode::Extraction& found) {
  Table over;
  set(over, "bus", make_bus(found, settings_.rig.bus));
  merge(tree_, over);
  settings_ = scenario::rebuild(settings_, tree_, end_.since_start);
}

bool ClosedLoop::knows(const config::Table& fault) const {
  const fault::Scope scope = fault::make_scope(settings_.root, settings_.rig);
  const std::string& target = text_of(fault, "target");
  const std::vector<std::string> targets = fault::list_targets(scope);
  if (std::ranges::find(targets, target) == targets.end()) return false;
  return std::ranges::any_of(fault::list_kinds(target, scope),
                             [&](const fault::KindInfo* kind) { return kind->name == text_of(fault, "kind"); });
}

ClosedLoopResult ClosedLoop::run(const std::vector<Table>& faults) {
  ++runs_;
  Table tree = tree_;
  Array list;
  for (const Table& fault : faults) list.push_back(Value{fault, {}});
  if (!list.empty()) set(tree, "fault", std::move(list));
  MemoryRun run{scenario::rebuild(settings_, std::move(tree), end_.since_start)};
  Listener listener{run.rig(), run.signals()};
  static_cast<void>(run.play(listener));
  return listener.finish(run.rig());
}

std::string describe_fault(const Table& fault) {
  std::string text = fmt::format("{} {}", text_of(fault, "target"), text_of(fault, "kind"));
  if (const config::Entry* at = fault.find("at_s"))
    text += fmt::format(" at {:.6g} s", std::get<double>(at->value.data));
  if (const config::Entry* lasts = fault.find("for_s")) {
    text += fmt::format(" for {:.6g} s", std::get<double>(lasts->value.data));
  }
  return text;
}

}  // namespace meltbench::cli
