#include "bench/cli/diagnosis.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "protocols/fault/fault.hpp"

namespace meltbench::cli {
namespace {

using config::Table;
using config::Value;
using decode::Traces;

constexpr std::size_t kSettles = 10;  // Samples: a departure before is no fault but another machine.
constexpr std::size_t kLine = 50;     // Samples that the slope of a drift is taken from: before the loops answer.
constexpr std::size_t kFrozen = 20;   // Samples of one value: stuck.
constexpr int kMoves = 6;             // Runs to move a beginning; it converges in two or three.
constexpr int kRefinements = 10;      // Runs to meet the time of the reaction.
constexpr double kMuchNearer = 0.3;   // Than no fault at all.
constexpr double kNear = 0.05;        // So near that it needs no better slope.
constexpr double kSteepest = 20.0;    // Times the slope of what is left of a drift.
constexpr int kSearches = 7;          // Of the slope, each of some runs.
constexpr Nanos kMet = 5ms;           // A reaction that is met so well is not improved.
constexpr Nanos kEarlier = 5s;        // Where a fault that shows no effect is tried next.
constexpr Nanos kBeforeEnd = 50ms;    // The window of the check at the end.

template <typename T>
void set(Table& table, std::string_view key, T value) {
  table.set(key, Value{std::move(value), {}});
}

double seconds(Instant at) {
  return std::round(to_s(at) * 1e6) / 1e6;
}
Instant instant(double at_s) {
  return Instant{Nanos{std::llround(at_s * 1e9)}};
}

/// What may have failed, and since when.
struct Suspect {
  std::string target;
  std::string kind;
  double at_s = 0.0;
  std::string slope_key;  ///< Of a drift: "drift_Pa_per_s".
  double slope = 0.0;

  [[nodiscard]] Table table() const {
    Table fault;
    set(fault, "target", target);
    set(fault, "kind", kind);
    set(fault, "at_s", seconds(instant(std::max(0.0, at_s))));
    if (!slope_key.empty()) set(fault, slope_key, slope);
    return fault;
  }
};

/// How well a suspect repeats the log.
struct Attempt {
  Suspect suspect;
  double distance = std::numeric_limits<double>::infinity();
  std::optional<Nanos> reacts_late;  ///< Than in the log; none if it does not react, or the log does not.
};

std::optional<Instant> safe_state_of(const std::vector<decode::Reaction>& reactions) {
  const auto found = std::ranges::find(reactions, decode::Reaction::Kind::kSafeState, &decode::Reaction::kind);
  return found == reactions.end() ? std::nullopt : std::optional{found->at};
}

class Detective {
 public:
  Detective(ClosedLoop& loop, const Traces& log, const std::vector<Table>& known, std::optional<Instant> reaction)
      : loop_{loop}, log_{log}, known_{known}, reaction_{reaction}, end_{log.size()} {
    for (const Table& fault : known) end_ = std::min(end_, Traces::sample_at(instant(time_of(fault))));
    if (reaction) end_ = std::min(end_, Traces::sample_at(*reaction));
  }

  Diagnosis find() {
    healthy_ = loop_.run(known_);
    const auto departure = decode::find_departure(log_, healthy_->traces, end_);
    if (!departure) return {};
    departure_ = *departure;
    const decode::Quantity& quantity = log_.quantities()[departure_.quantity];
    const double at_s = to_s(Traces::time_of(departure_.sample));
    if (departure_.sample < kSettles) {
      return {{}, {}, fmt::format("from the beginning, {} is not what these settings make of it", quantity.sensor)};
    }
    const double nothing = decode::calc_distance(log_, healthy_->traces, departure_.sample, end_);
    Attempt best, best_drift;
    for (Suspect& suspect : list_suspects()) {
      Attempt& place = suspect.slope_key.empty() ? best : best_drift;
      Attempt attempt = move(std::move(suspect));
      if (attempt.distance < place.distance) place = std::move(attempt);
    }
    const double nearest = std::min(best.distance, best_drift.distance);
    if (nearest > kNear * nothing && std::isfinite(best_drift.distance)) best_drift = search_slope(best_drift);
    if (best_drift.distance < best.distance) best = best_drift;
    if (best.distance < kMuchNearer * nothing) best = refine(std::move(best));
    if (!(best.distance < kMuchNearer * nothing)) {
      return {{},
              {},
              fmt::format("{:.3f} s: {} leaves what a healthy machine has, and no fault repeats it", at_s,
                          quantity.sensor)};
    }
    std::string text = fmt::format("{:.3f} s: {} leaves what a healthy machine has: {}", at_s, quantity.sensor,
                                   describe_fault(best.suspect.table()));
    if (best.reacts_late) text += fmt::format(", reaction {:+.3f} s", to_s(*best.reacts_late));
    return {best.suspect.table(), make_check(), std::move(text)};
  }

 private:
  [[nodiscard]] static double time_of(const Table& fault) {
    const config::Entry* at = fault.find("at_s");
    return at == nullptr ? 0.0 : std::get<double>(at->value.data);
  }

  [[nodiscard]] double apart(std::size_t sample) const {
    return static_cast<double>(log_.of(departure_.quantity)[sample]) -
           static_cast<double>(healthy_->traces.of(departure_.quantity)[sample]);
  }

  /// Everything that could move this measurement first. What cannot be ruled out by the log alone.
  [[nodiscard]] std::vector<Suspect> list_suspects() const {
    const std::string& sensor = log_.quantities()[departure_.quantity].sensor;
    const double at_s = to_s(Traces::time_of(departure_.sample));
    const bool is_above = apart(departure_.sample) > 0.0;
    const bool is_zone = sensor.starts_with("zone") || sensor == "nozzle";
    std::vector<Suspect> list;
    if (const auto since = find_frozen()) {
      list.push_back({"sensor." + sensor, "stuck", to_s(Traces::time_of(*since)), {}, 0.0});
    }
    if (auto drift = fit_drift(sensor)) list.push_back(std::move(*drift));
    if (is_zone) list.push_back({"actuator." + sensor, is_above ? "welded_on" : "dead", at_s, {}, 0.0});
    if (sensor == "melt_pressure" && !is_above) list.push_back({"plant", "feeder_bridging", at_s, {}, 0.0});
    std::erase_if(list, [&](const Suspect& suspect) { return !loop_.knows(suspect.table()); });
    return list;
  }

  /// First sample of the value that does not change any more.
  [[nodiscard]] std::optional<std::size_t> find_frozen() const {
    const auto values = log_.of(departure_.quantity);
    const float value = values[departure_.sample];
    std::size_t first = departure_.sample;
    while (first > 0 && values[first - 1] == value) --first;
    std::size_t last = departure_.sample;
    while (last + 1 < end_ && values[last + 1] == value) ++last;
    if (last + 1 - first < kFrozen) return std::nullopt;
    return first;
  }

  /// A straight line through how far the log is from health, by least squares; where it is zero, it began.
  [[nodiscard]] std::optional<Suspect> fit_drift(const std::string& sensor) const {
    const std::size_t last = std::min(departure_.sample + kLine, end_);
    const auto count = static_cast<double>(last - departure_.sample);
    if (count < 10) return std::nullopt;
    double sum_t = 0, sum_d = 0, sum_tt = 0, sum_td = 0;
    for (std::size_t i = departure_.sample; i < last; ++i) {
      const double t = to_s(Traces::time_of(i)), d = apart(i);
      sum_t += t, sum_d += d, sum_tt += t * t, sum_td += t * d;
    }
    const double slope = (count * sum_td - sum_t * sum_d) / (count * sum_tt - sum_t * sum_t);
    const double begins_s = (sum_t - sum_d / slope) / count;
    if (!std::isfinite(begins_s) || slope == 0.0) return std::nullopt;
    const fault::ObjectInfo* object = fault::object_of("sensor." + sensor);
    if (object == nullptr) return std::nullopt;
    return Suspect{"sensor." + sensor, "drift", begins_s, fmt::format("drift_{}_per_s", object->unit),
                   slope * log_.quantities()[departure_.quantity].si_per_digit};
  }

  ClosedLoopResult run(const Suspect& suspect) {
    std::vector<Table> faults = known_;
    faults.push_back(suspect.table());
    return loop_.run(faults);
  }

  Attempt judge(Suspect suspect, const ClosedLoopResult& result) const {
    const double distance = decode::calc_distance(log_, result.traces, departure_.sample, end_);
    const auto safe = safe_state_of(result.reactions);
    Attempt attempt{std::move(suspect), distance, std::nullopt};
    if (safe && reaction_) attempt.reacts_late = *safe - *reaction_;
    return attempt;
  }

  /// Moves the beginning until the departure comes when it did in the log. That of a stuck sensor is known by its
  /// value.
  Attempt move(Suspect suspect) {
    Attempt best;
    for (int i = 0; i < (suspect.kind == "stuck" ? 1 : kMoves); ++i) {
      const ClosedLoopResult result = run(suspect);
      Attempt attempt = judge(suspect, result);
      if (attempt.distance < best.distance) best = attempt;
      const auto departs = decode::find_departure(result.traces, healthy_->traces, departure_.quantity, log_.size());
      const Nanos late = departs ? Traces::time_of(*departs) - Traces::time_of(departure_.sample) : kEarlier;
      if (late == Nanos{0} || (late > Nanos{0} && suspect.at_s <= 0.0)) break;
      suspect.at_s = std::max(0.0, suspect.at_s - to_s(late));
    }
    return best;
  }

  /// A loop hides a drift of what it controls: the line through what is left of it is too flat. Golden section, on a
  /// logarithmic scale, for the slope that comes nearest to the log.
  Attempt search_slope(Attempt best) {
    const double flat = best.suspect.slope;
    double low = 0.0, high = std::log(kSteepest);
    const auto at = [&](double exponent) {
      Suspect suspect = best.suspect;
      suspect.slope = flat * std::exp(exponent);
      return move(std::move(suspect));
    };
    constexpr double kGolden = 0.381966;
    double first = low + kGolden * (high - low), second = high - kGolden * (high - low);
    Attempt one = at(first), other = at(second);
    for (int i = 0; i < kSearches; ++i) {
      if (one.distance < best.distance) best = one;
      if (other.distance < best.distance) best = other;
      if (one.distance < other.distance) {
        high = second, second = first, other = one;
        one = at(first = low + kGolden * (high - low));
      } else {
        low = first, first = second, one = other;
        other = at(second = high - kGolden * (high - low));
      }
    }
    return best;
  }

  /// Meets the time of the reaction: by when it began, or, with a drift, by how fast it is. Newton's rule with the
  /// slope of the last two attempts.
  Attempt refine(Attempt best) {
    if (!reaction_ || !best.reacts_late) return best;
    const bool is_drift = best.suspect.kind == "drift";
    const auto value_of = [&](Suspect& suspect) -> double& { return is_drift ? suspect.slope : suspect.at_s; };
    const double begins_s = best.suspect.at_s;
    // A faster drift reacts sooner: the time from its beginning is about inverse to it.
    double slope = is_drift ? -(to_s(*reaction_) - begins_s) / best.suspect.slope : 1.0;
    Attempt last = best;
    for (int i = 0; i < kRefinements && std::chrono::abs(*best.reacts_late) > kMet; ++i) {
      Suspect next = last.suspect;
      value_of(next) -= to_s(*last.reacts_late) / slope;
      Attempt attempt = judge(next, run(next));
      if (!attempt.reacts_late) break;
      const double moved = value_of(next) - value_of(last.suspect);
      const double changed = to_s(*attempt.reacts_late - *last.reacts_late);
      if (moved != 0.0 && changed / moved * slope > 0.0) slope = changed / moved;
      if (std::chrono::abs(*attempt.reacts_late) < std::chrono::abs(*best.reacts_late)) best = attempt;
      last = std::move(attempt);
    }
    return best;
  }

  /// That the measurement has come to where it was at the end of what is compared.
  [[nodiscard]] Table make_check() const {
    const decode::Quantity& quantity = log_.quantities()[departure_.quantity];
    const std::size_t last = std::max(departure_.sample, end_ - 1);
    const double value = static_cast<double>(log_.of(departure_.quantity)[last]);
    const Instant at = Traces::time_of(last);
    Table check;
    set(check, "name", fmt::format("{} is where it was", quantity.sensor));
    set(check, "kind", std::string{"band"});
    set(check, "signal", quantity.signal);
    set(check, "min", value - quantity.tell);
    set(check, "max", value + quantity.tell);
    set(check, "from_s", seconds(std::max(Instant{}, Instant{at - kBeforeEnd})));
    set(check, "to_s", seconds(at));
    return check;
  }

  ClosedLoop& loop_;
  const Traces& log_;
  const std::vector<Table>& known_;
  std::optional<Instant> reaction_;
  std::size_t end_;
  std::optional<ClosedLoopResult> healthy_;
  decode::Departure departure_;
};

}  // namespace

Diagnosis diagnose(ClosedLoop& loop, const decode::Traces& log, const std::vector<Table>& known,
                   std::optional<Instant> reaction) {
  return Detective{loop, log, known, reaction}.find();
}

}  // namespace meltbench::cli
