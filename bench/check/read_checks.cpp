#include "bench/check/read_checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>

namespace meltbench::check {
namespace {

using config::Range;
using config::Section;

constexpr std::array<std::string_view, std::variant_size_v<Kind>> kKindNames{
    "settle",       "never_settles", "band",     "overshoot", "peak_to_peak", "response", "frame_period",
    "frame_jitter", "bus_load",      "reaction", "always",    "never",        "event"};

Instant instant_or(const Section& section, std::string_view key, Instant fallback) {
  return section.has(key) ? Instant{section.duration(key)} : (static_cast<void>(section.duration_or(key, 0)), fallback);
}

std::optional<double> optional_number(const Section& section, std::string_view key, const Range& range = {}) {
  if (section.has(key)) return section.number(key, range);
  static_cast<void>(section.number_or(key, 0));  // Makes the key known, for the list of nearest keys.
  return std::nullopt;
}

Quantity read_quantity(const Section& section) {
  return {section.text("signal"), section.text_or("minus", "")};
}

Window read_window(const Section& section) {
  const Window window{instant_or(section, "from_s", Instant{}), instant_or(section, "to_s", Instant::never())};
  if (window.to < window.from) section.fail("to_s", "must not be before from_s");
  return window;
}

/// Two bounds of which one may be missing.
std::pair<std::optional<double>, std::optional<double>> read_bounds(const Section& section, std::string_view low,
                                                                    std::string_view high) {
  const auto min = optional_number(section, low);
  const auto max = optional_number(section, high);
  if (!min && !max) section.fail_here(fmt::format("needs {}, {} or both", low, high));
  if (min && max && *min > *max) section.fail(high, fmt::format("must not be below {}", low));
  return {min, max};
}

Condition read_condition(const Section& section) {
  Condition condition{read_quantity(section), {}, {}};
  std::tie(condition.above, condition.below) = read_bounds(section, "above", "below");
  return condition;
}

std::optional<Condition> read_during(const Section& section) {
  if (!section.has("during")) {
    static_cast<void>(section.section_or_empty("during"));
    return std::nullopt;
  }
  return read_condition(section.section("during"));
}

std::uint32_t read_cob_id(const Section& section, std::string_view key) {
  return static_cast<std::uint32_t>(
      section.integer(key, config::between(0, can::kMaxStandardId, "an 11-bit identifier, e.g. cob_id = 0x185")));
}

double read_percentile(const Section& section) {
  return section.number_or("percentile", 100, config::above_up_to(0, 100, "100 judges every period, 99 all but 1 %"));
}

Kind read_settle(const Section& section) {
  Settle settle;
  settle.quantity = read_quantity(section);
  settle.target = section.number("target");
  settle.tolerance = section.number("tolerance", config::above(0, "half width of the band, in the signal's unit"));
  settle.within = Instant{section.duration("within_s")};
  settle.not_before = instant_or(section, "not_before_s", Instant{});
  settle.until = instant_or(section, "until_s", Instant::never());
  if (settle.within < settle.not_before) section.fail("within_s", "must not be before not_before_s");
  if (settle.until <= settle.within) section.fail("until_s", "must be after within_s");
  return settle;
}

Kind read_never_settles(const Section& section) {
  NeverSettles never;
  never.quantity = read_quantity(section);
  never.target = section.number("target");
  never.tolerance = section.number("tolerance", config::at_least(0));
  never.over_last = section.duration("over_last_s", config::above(0, "the last part of the run, e.g. two swings"));
  return never;
}

Kind read_band(const Section& section) {
  Band band;
  band.quantity = read_quantity(section);
  std::tie(band.min, band.max) = read_bounds(section, "min", "max");
  band.window = read_window(section);
  return band;
}

Kind read_overshoot(const Section& section) {
  Overshoot overshoot;
  overshoot.quantity = read_quantity(section);
  overshoot.target = section.number("target");
  overshoot.max = section.number("max", config::at_least(0, "how far beyond the target, in the signal's unit"));
  overshoot.window = read_window(section);
  return overshoot;
}

Kind read_peak_to_peak(const Section& section) {
  PeakToPeak peak;
  peak.quantity = read_quantity(section);
  std::tie(peak.min, peak.max) = read_bounds(section, "min", "max");
  peak.window = read_window(section);
  return peak;
}

Kind read_response(const Section& section) {
  Response response;
  response.quantity = read_quantity(section);
  response.level = section.number("level");
  response.from = instant_or(section, "from_s", Instant{});
  response.within = Instant{section.duration("within_s")};
  response.not_before = instant_or(section, "not_before_s", Instant{});
  if (response.within < response.not_before) section.fail("within_s", "must not be before not_before_s");
  return response;
}

Kind read_frame_period(const Section& section) {
  FramePeriod period;
  period.cob_id = read_cob_id(section, "cob_id");
  period.period = section.duration("period_ms", config::above(0));
  period.max_deviation = section.duration("max_deviation_ms");
  period.percentile = read_percentile(section);
  period.window = read_window(section);
  return period;
}

Kind read_frame_jitter(const Section& section) {
  FrameJitter jitter;
  jitter.cob_id = read_cob_id(section, "cob_id");
  jitter.max = section.duration("max_ms");
  jitter.percentile = read_percentile(section);
  jitter.window = read_window(section);
  return jitter;
}

Kind read_bus_load(const Section& section) {
  BusLoad load;
  load.max = section.number("max", config::between(0, 1));
  load.over = section.duration_or("over_ms", 100, config::above(0));
  load.window = read_window(section);
  return load;
}

/// "30 81 ..": two hex digits a byte, ".." for any byte.
std::vector<std::optional<std::uint8_t>> read_pattern(const Section& section) {
  constexpr const char* kHint = "two hex digits per byte, .. for any byte, e.g. data = \"30 81\"";
  std::string digits = section.text_or("data", "");
  digits.erase(std::remove(digits.begin(), digits.end(), ' '), digits.end());
  if (digits.size() % 2 != 0 || digits.size() > 2 * can::kMaxFdLength)
    section.fail("data", "must be whole bytes", kHint);
  std::vector<std::optional<std::uint8_t>> pattern;
  for (std::size_t i = 0; i < digits.size(); i += 2) {
    const std::string byte = digits.substr(i, 2);
    if (byte == "..") {
      pattern.emplace_back();
    } else if (byte.find_first_not_of("0123456789abcdefABCDEF") == std::string::npos) {
      pattern.emplace_back(static_cast<std::uint8_t>(std::stoul(byte, nullptr, 16)));
    } else {
      section.fail("data", "must be hex", kHint);
    }
  }
  return pattern;
}

/// One of { at_s }, { event, source }, { cob_id, data }, { signal, above, below }.
Moment read_moment(const Section& section) {
  if (section.has("at_s")) return {Moment::At{Instant{section.duration("at_s")}}};
  if (section.has("event")) return {Moment::OnEvent{section.text("event"), section.text_or("source", "")}};
  if (section.has("cob_id")) return {Moment::OnFrame{read_cob_id(section, "cob_id"), read_pattern(section)}};
  if (section.has("signal")) {
    const Condition condition = read_condition(section);
    return {Moment::OnSignal{condition.quantity, condition.above, condition.below}};
  }
  section.fail_here("says no moment",
                    "one of { at_s = 10 }, { event = \"heartbeat-lost\" }, { cob_id = 0x085, data = \"30 81\" }, "
                    "{ signal = \"plant.x_m\", above = 0.17 }");
}

Kind read_reaction(const Section& section) {
  Reaction reaction;
  reaction.from = read_moment(section.section("from"));
  reaction.to = read_moment(section.section("to"));
  reaction.within = section.duration("within_ms");
  reaction.every = section.boolean_or("every", false);
  return reaction;
}

Kind read_always(const Section& section) {
  return Always{read_condition(section), read_during(section), read_window(section)};
}

Kind read_never(const Section& section) {
  return Never{read_condition(section), read_during(section), read_window(section)};
}

Kind read_event(const Section& section) {
  EventOccurs event;
  event.code = section.text("code");
  event.source = section.text_or("source", "");
  if (section.has("count")) event.count = section.integer("count", config::at_least(0, "0 = must not occur"));
  static_cast<void>(section.integer_or("count", 0));
  event.window = read_window(section);
  return event;
}

Check read_check(const Section& section) {
  Check check;
  check.name = section.text("name");
  check.origin = section.origin();
  using Reader = Kind (*)(const Section&);
  const auto read = section.choice<Reader>("kind", {{"settle", &read_settle},
                                                    {"never_settles", &read_never_settles},
                                                    {"band", &read_band},
                                                    {"overshoot", &read_overshoot},
                                                    {"peak_to_peak", &read_peak_to_peak},
                                                    {"response", &read_response},
                                                    {"frame_period", &read_frame_period},
                                                    {"frame_jitter", &read_frame_jitter},
                                                    {"bus_load", &read_bus_load},
                                                    {"reaction", &read_reaction},
                                                    {"always", &read_always},
                                                    {"never", &read_never},
                                                    {"event", &read_event}});
  section.ignore({"variants"});
  check.kind = read(section);
  section.finish();
  return check;
}

HealthGate read_health(const Section& section) {
  HealthGate gate{section.texts_or_none("expect")};
  for (const std::string& entry : gate.expect) {
    const bool is_word = entry == "error-frames" || entry == "lost-frames";
    const bool is_emcy = entry.starts_with("emcy:") && entry.find(':', 5) != std::string::npos;
    if (is_word || is_emcy || entry.find('.') != std::string::npos) continue;
    section.fail("expect", fmt::format("holds \"{}\", which names nothing that the health gate finds", entry),
                 "\"source.event-code\", \"emcy:feeder:8130\", an error counter signal, \"error-frames\" or "
                 "\"lost-frames\"");
  }
  section.finish();
  return gate;
}

/// Calls visit(signal name) for every signal that a kind needs.
template <typename Visit>
struct SignalsOf {
  Visit visit;
  void operator()(const Quantity& quantity) const {
    visit(quantity.signal);
    if (!quantity.minus.empty()) visit(quantity.minus);
  }
  void operator()(const Moment& moment) const {
    if (const auto* on_signal = std::get_if<Moment::OnSignal>(&moment.what)) (*this)(on_signal->quantity);
  }
  template <typename K>
  void operator()(const K& kind) const {
    if constexpr (std::is_same_v<K, Reaction>) {
      (*this)(kind.from);
      (*this)(kind.to);
    } else if constexpr (std::is_same_v<K, Always> || std::is_same_v<K, Never>) {
      (*this)(kind.condition.quantity);
      if (kind.during) (*this)(kind.during->quantity);
    } else if constexpr (requires { kind.quantity; }) {
      (*this)(kind.quantity);
    }
  }
};

/// Calls require(key, instant) for every instant that a kind names.
template <typename Require>
struct TimesOf {
  Require require;
  void operator()(const Moment& moment) const {
    if (const auto* at = std::get_if<Moment::At>(&moment.what)) require("at_s", at->at);
  }
  template <typename K>
  void operator()(const K& kind) const {
    if constexpr (requires { kind.window; }) {
      require("from_s", kind.window.from);
      require("to_s", kind.window.to);
    } else if constexpr (std::is_same_v<K, Settle>) {
      require("within_s", kind.within);
      require("until_s", kind.until);
    } else if constexpr (std::is_same_v<K, Response>) {
      require("from_s", kind.from);
      require("within_s", kind.within);
    } else if constexpr (std::is_same_v<K, Reaction>) {
      (*this)(kind.from);
      (*this)(kind.to);
    } else {
      static_assert(std::is_same_v<K, NeverSettles>);
      require("over_last_s", Instant{kind.over_last});
    }
  }
};

CheckResult describe(const Health& health) {
  constexpr std::size_t kShown = 3;
  CheckResult result;
  result.name = result.kind = "health";
  result.held = health.held;
  result.unit = "findings";
  result.margin = -static_cast<double>(health.findings.size());
  if (health.held) {
    result.margin = 0;
    result.text = health.expected.empty()
                      ? "nothing unexpected"
                      : fmt::format("nothing but what is expected: {}", fmt::join(health.expected, ", "));
    return result;
  }
  const std::size_t shown = std::min(kShown, health.findings.size());
  result.text = fmt::format(
      "{}", fmt::join(health.findings.begin(), health.findings.begin() + static_cast<std::ptrdiff_t>(shown), "; "));
  if (shown < health.findings.size()) result.text += fmt::format("; and {} more", health.findings.size() - shown);
  return result;
}

}  // namespace

std::vector<std::string> CheckSet::signal_names() const {
  std::vector<std::string> names;
  const auto note = [&names](const std::string& name) { names.push_back(name); };
  for (const Check& check : checks) std::visit(SignalsOf<decltype(note)>{note}, check.kind);
  return names;
}

void CheckSet::require_signals(const std::vector<SignalInfo>& signals, const record::RunInfo& info) const {
  std::vector<std::string> names;
  for (const SignalInfo& signal : signals) names.push_back(signal.name);
  for (const Check& check : checks) {
    const auto require = [&](const std::string& name) {
      if (info.is_unseen(name) || std::find(names.begin(), names.end(), name) != names.end()) return;
      const std::string_view near = config::nearest(name, names);
      throw config::ConfigError(check.origin, fmt::format("check \"{}\": there is no signal \"{}\"", check.name, name),
                                near.empty() ? "signals.csv of any run of this rig names them all in its first line"
                                             : fmt::format("did you mean \"{}\"?", near));
    };
    std::visit(SignalsOf<decltype(require)>{require}, check.kind);
  }
}

void CheckSet::require_times(Nanos duration) const {
  for (const Check& check : checks) {
    const auto require = [&](std::string_view key, Instant at) {
      if (at == Instant::never() || at.since_start <= duration) return;
      throw config::ConfigError(
          check.origin,
          fmt::format("check \"{}\": {} = {} s, but the run ends at {} s", check.name, key, to_s(at), to_s(duration)),
          "move it, or lengthen scenario.duration_s");
    };
    std::visit(TimesOf<decltype(require)>{require}, check.kind);
  }
}

CheckResults CheckSet::judge(const record::Recording& recording) const {
  CheckResults results;
  for (const Check& check : checks) {
    CheckResult result = std::visit([&](const auto& kind) { return kind.judge(recording); }, check.kind);
    result.name = check.name;
    result.kind = kKindNames.at(check.kind.index());
    results.checks.push_back(std::move(result));
  }
  results.health = health.judge(recording);
  results.checks.push_back(describe(results.health));
  return results;
}

CheckSet read_checks(const Section& root) {
  CheckSet set;
  std::set<std::string> names{"health"};
  for (const Section& section : root.sections("check")) {
    set.checks.push_back(read_check(section));
    if (!names.insert(set.checks.back().name).second) {
      section.fail("name", "given twice", "scripts find a check by its name; \"health\" is the implicit gate's");
    }
  }
  set.health = read_health(root.section_or_empty("health"));
  return set;
}

}  // namespace meltbench::check
