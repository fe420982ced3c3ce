#include "bench/replay/comparison.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "protocols/can/candump.hpp"

namespace meltbench::replay {
namespace {

/// "2.000 ms".
std::string to_ms(Nanos span) {
  return fmt::format("{:.3f} ms", static_cast<double>(std::chrono::abs(span).count()) * 1e-6);
}

/// The oldest of the same identifier that is near enough, and passes `fits`.
template <typename List, typename Fits>
auto find_partner(List& list, Instant at, const can::CanFrame& frame, Nanos reach, Fits fits) {
  return std::ranges::find_if(list, [&](const auto& other) {
    return other.frame.id == frame.id && other.frame.extended == frame.extended &&
           std::chrono::abs(other.at - at) <= reach && fits(other.frame);
  });
}

/// As many digits as tell it from every other value of its type.
std::string write(const decode::DecodedValue& value) {
  return value.type == canopen::DataType::kReal32 ? fmt::format("{}", static_cast<float>(value.value))
                                                  : fmt::format("{}", value.value);
}

constexpr auto kAny = [](const can::CanFrame&) { return true; };

}  // namespace

void Comparison::expect(const ScriptFrame& recorded) {
  const Spoken spoken{recorded.at, recorded.frame, recorded.line};
  const auto early = find_partner(early_, recorded.at, recorded.frame, tolerance_.time, kAny);
  if (early == early_.end()) {
    expected_.push_back(spoken);
    return;
  }
  match(spoken, *early);
  early_.erase(early);
}

void Comparison::answer(Instant at, const can::CanFrame& frame) {
  ++compared_;
  const Spoken spoken{at, frame, 0};
  const auto fits = [&](const can::CanFrame& recorded) { return compare(recorded, frame).empty(); };
  auto partner = find_partner(expected_, at, frame, tolerance_.time, kAny);
  if (partner != expected_.end()) {
    match(*partner, spoken);
    expected_.erase(partner);
  } else if (partner = find_partner(overdue_, at, frame, window(), fits); partner != overdue_.end()) {
    match(*partner, spoken);
    overdue_.erase(partner);
  } else {
    early_.push_back(spoken);
  }
  view_.take(frame);
}

/// Holds an answer against its recorded frame.
void Comparison::match(const Spoken& recorded, const Spoken& answered) {
  const std::string changed = compare(recorded.frame, answered.frame);
  if (watcher_) tell_values(recorded, answered);
  const Nanos shift = answered.at - recorded.at;
  if (std::chrono::abs(shift) > tolerance_.time) {
    const bool is_late = shift > Nanos{};
    note(is_late ? Difference::Kind::kLate : Difference::Kind::kEarly, recorded,
         fmt::format("\"{}\" comes {} {} than in the recording{}{}", view_.describe(answered.frame), to_ms(shift),
                     is_late ? "later" : "earlier", changed.empty() ? "" : "; ", changed));
  } else if (!changed.empty()) {
    note(Difference::Kind::kChanged, recorded, changed);
  } else {
    worst_shift_ = std::max(worst_shift_, Nanos{std::chrono::abs(shift)});
  }
}

void Comparison::tell_values(const Spoken& recorded, const Spoken& answered) {
  const auto before = view_.values_of(recorded.frame);
  const std::vector<decode::DecodedValue> was{before.begin(), before.end()};
  const auto now = view_.values_of(answered.frame);
  const std::uint8_t node = view_.meaning_of(recorded.frame).node;
  for (std::size_t i = 0; i < std::min(was.size(), now.size()); ++i) {
    watcher_({node, recorded.at, recorded.line, was[i], now[i]});
  }
}

/// In what the content differs, in words; empty if it does not, or within the tolerances.
std::string Comparison::compare(const can::CanFrame& recorded, const can::CanFrame& answered) {
  if (recorded == answered) return {};
  const decode::FrameMeaning meaning = view_.meaning_of(recorded);
  const auto before = view_.values_of(recorded);
  const std::vector<decode::DecodedValue> was{before.begin(), before.end()};
  const auto now = view_.values_of(answered);
  if (was.empty() || was.size() != now.size() || recorded.length != answered.length) {
    return fmt::format("\"{}\" [{}] instead of \"{}\" [{}]", view_.describe(answered), can::to_candump(answered),
                       view_.describe(recorded), can::to_candump(recorded));
  }
  for (std::size_t i = 0; i < was.size(); ++i) {
    const auto allowed = tolerance_.values.find({meaning.node, was[i].address});
    const double limit = allowed == tolerance_.values.end() ? 0.0 : allowed->second;
    const bool both_invalid = std::isnan(now[i].value) && std::isnan(was[i].value);
    if (both_invalid || std::abs(now[i].value - was[i].value) <= limit) continue;
    return fmt::format("{} {}, {}: {} instead of {} (may differ by {:.3g})", view_.name_of(meaning.node),
                       text(was[i].address), was[i].name, write(now[i]), write(was[i]), limit);
  }
  return {};
}

void Comparison::expire(Instant now) {
  while (!expected_.empty() && expected_.front().at + tolerance_.time < now) {
    const Spoken recorded = expected_.front();
    expected_.pop_front();
    const auto fits = [&](const can::CanFrame& answered) { return compare(recorded.frame, answered).empty(); };
    const auto early = find_partner(early_, recorded.at, recorded.frame, window(), fits);
    if (early == early_.end()) {
      overdue_.push_back(recorded);
    } else {
      match(recorded, *early);
      early_.erase(early);
    }
  }
  for (; !overdue_.empty() && overdue_.front().at + window() < now; overdue_.pop_front()) {
    const Spoken& recorded = overdue_.front();
    const auto other = find_partner(early_, recorded.at, recorded.frame, window(), kAny);
    if (other == early_.end()) {
      note(Difference::Kind::kMissing, recorded, fmt::format("\"{}\" is not said", view_.describe(recorded.frame)));
    } else {
      match(recorded, *other);
      early_.erase(other);
    }
  }
  for (; !early_.empty() && early_.front().at + window() < now; early_.pop_front()) {
    note(Difference::Kind::kUnexpected, early_.front(),
         fmt::format("\"{}\" was not said in the recording", view_.describe(early_.front().frame)));
  }
}

Instant Comparison::next_expiry() const {
  return expected_.empty() ? Instant::never() : expected_.front().at + tolerance_.time + 1ns;
}

void Comparison::finish(Instant end) {
  expire(end + tolerance_.time + 1ns);
  expire(end + window() + tolerance_.time + 2ns);
  std::ranges::stable_sort(differences_, {}, &Difference::at);
}

void Comparison::note(Difference::Kind kind, const Spoken& what, std::string text) {
  ++count_;
  if (differences_.size() < kKept) differences_.push_back({kind, what.at, what.line, std::move(text)});
}

}  // namespace meltbench::replay
