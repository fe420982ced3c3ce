#include <algorithm>
#include <utility>
#include <vector>

#include "bench/check/kinds.hpp"
#include "bench/check/series.hpp"

namespace meltbench::check {
namespace {

bool matches(const Event& event, const std::string& event_source, const std::string& code, const std::string& source) {
  return event.code == code && (source.empty() || event_source == source);
}

bool matches(const can::CanFrame& frame, const std::vector<std::optional<std::uint8_t>>& data) {
  if (frame.data().size() < data.size()) return false;
  for (std::size_t i = 0; i < data.size(); ++i) {
    if (data[i] && *data[i] != frame.bytes[i]) return false;
  }
  return true;
}

/// All moments of the recording, oldest first. `outcome.text` is set if they cannot be looked for.
class MomentFinder {
 public:
  MomentFinder(const record::Recording& recording, Outcome& outcome) : recording_{recording}, outcome_{outcome} {}

  std::vector<Instant> operator()(const Moment::At& moment) const { return {moment.at}; }

  std::vector<Instant> operator()(const Moment::OnEvent& moment) const {
    std::vector<Instant> found;
    if (recording_.info.is_unseen(moment.source)) {
      outcome_ = skipped(std::move(outcome_), moment.source + "." + moment.code);
      return found;
    }
    for (const record::RecordedEvent& e : recording_.events) {
      if (matches(e.event, e.source, moment.code, moment.source)) found.push_back(e.event.at);
    }
    std::sort(found.begin(), found.end());
    return found;
  }

  std::vector<Instant> operator()(const Moment::OnFrame& moment) const {
    std::vector<Instant> found;
    for (std::size_t i = 0; i < recording_.frames.size(); ++i) {
      if (!recording_.frames.is_standard_data(i, moment.cob_id)) continue;
      if (matches(recording_.frames[i].frame, moment.data)) found.push_back(recording_.frames.at(i));
    }
    return found;
  }

  std::vector<Instant> operator()(const Moment::OnSignal& moment) const {
    std::vector<Instant> found;
    const auto series = resolve(recording_, moment.quantity, outcome_);
    if (!series) return found;
    bool before = false;
    for (std::size_t row = 0; row < recording_.row_count(); ++row) {
      const bool now = distance_inside((*series)[row], moment.above, moment.below) >= 0;
      if (now && !before) found.push_back(recording_.row_times[row]);
      before = now;
    }
    return found;
  }

 private:
  const record::Recording& recording_;
  Outcome& outcome_;
};

}  // namespace

Outcome Reaction::judge(const record::Recording& recording) const {
  Outcome outcome;
  const MomentFinder find{recording, outcome};
  const std::vector<Instant> causes = std::visit(find, from.what);
  const std::vector<Instant> effects = outcome.text.empty() ? std::visit(find, to.what) : std::vector<Instant>{};
  outcome.unit = std::string(1, 's');
  if (!outcome.text.empty()) return outcome;
  if (causes.empty()) return failed(std::move(outcome), "what it reacts to never happened");

  const double within_s = to_s(within);
  const std::size_t judged_count = every ? causes.size() : 1;
  Outcome worst;
  std::size_t counted = 0;
  for (std::size_t i = 0; i < judged_count; ++i) {
    const Instant cause = causes[i];
    const auto effect = std::lower_bound(effects.begin(), effects.end(), cause);
    const bool seen = effect != effects.end();
    // The run ended before this one was due. Only the first one must be judged.
    if (!seen && i > 0 && recording.ending.at - cause < within) continue;
    const Instant end = seen ? *effect : std::max(cause, recording.ending.at);
    const double took_s = to_s(end - cause);
    const double margin = seen ? within_s - took_s : strictly_negative(within_s - took_s);
    ++counted;
    if (counted > 1 && margin >= worst.margin) continue;
    worst =
        judged(outcome, margin, to_s(cause),
               seen ? fmt::format("after {:.6g} ms; asked for: within {:.6g} ms", 1e3 * took_s, 1e3 * within_s)
                    : fmt::format("no reaction to {:.6g} s in the {:.6g} ms to the end; asked for: within {:.6g} ms",
                                  to_s(cause), 1e3 * took_s, 1e3 * within_s));
  }
  if (every) worst.text += fmt::format(" (worst of {})", counted);
  return worst;
}

Outcome EventOccurs::judge(const record::Recording& recording) const {
  Outcome outcome;
  outcome.unit = "events";
  if (recording.info.is_unseen(source)) return skipped(std::move(outcome), source + "." + code);
  std::int64_t found = 0;
  for (const record::RecordedEvent& e : recording.events) {
    if (e.event.at < window.from || e.event.at > window.to || !matches(e.event, e.source, code, source)) continue;
    if (found++ == 0) outcome.at_s = to_s(e.event.at);
  }
  const std::int64_t margin = count ? -std::abs(found - *count) : found - 1;
  outcome.margin = static_cast<double>(margin);
  outcome.held = margin >= 0;
  outcome.text = fmt::format("{} times{}; asked for: {}", found,
                             outcome.at_s ? fmt::format(", first at {:.6g} s", *outcome.at_s) : std::string{},
                             count ? fmt::format("{} times", *count) : std::string{"at least once"});
  return outcome;
}

}  // namespace meltbench::check
