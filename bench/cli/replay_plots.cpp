#include "bench/cli/replay_plots.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace meltbench::cli {
namespace {

constexpr std::size_t kMaxValues = 600'000;  // Of all signals; 4 bytes each of those that differ.

}  // namespace

std::pair<std::string, std::string> split_unit(const std::string& name) {
  const std::size_t at = name.rfind(" in ");
  if (at == std::string::npos) return {name, {}};
  return {name.substr(0, at), name.substr(at + 4)};
}

void ReplayPlots::take(const replay::ValuePair& pair) {
  const replay::Fits::Key key{pair.node, pair.recorded.address};
  auto place = lines_.find(key);
  if (place == lines_.end()) {
    if (signals_.size() + 2 > report::ThinnedSignals::kMaxSignals) return;
    const Lines added{*signals_.add("recorded"), *signals_.add("replayed")};
    place = lines_.emplace(key, added).first;
  }
  latest_ = std::max(latest_, pair.at);  // A late answer is compared when others have been.
  signals_.take(place->second.recorded, latest_, pair.recorded.value);
  signals_.take(place->second.replayed, latest_, pair.answered.value);
}

report::Plots ReplayPlots::finish(const replay::Fits& fits, const decode::BusView& view) {
  signals_.fold_to(kMaxValues);
  report::Plots plots;
  plots.times_s = signals_.times_s();
  plots.thinned = true;
  for (const auto& [key, fit] : fits.signals()) {
    if (fit.differing == 0) continue;
    const auto lines = lines_.find(key);
    if (lines == lines_.end()) {
      ++left_out_;
      continue;
    }
    const auto [name, unit] = split_unit(fit.name);
    const std::string object = text(key.second);
    plots.plots.push_back(
        {fmt::format("{}: {}", view.name_of(key.first), name),
         unit,
         {{object, 0, signals_.values(lines->second.recorded)}, {object, 1, signals_.values(lines->second.replayed)}},
         true});
  }
  return plots;
}

}  // namespace meltbench::cli
