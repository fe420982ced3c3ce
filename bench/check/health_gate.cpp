#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "bench/check/kinds.hpp"

namespace meltbench::check {
namespace {

std::string lower_case(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

/// Collects findings, equal ones once, and keeps book of what was expected.
class Findings {
 public:
  explicit Findings(const std::vector<std::string>& expect) : expect_{expect}, met_(expect.size(), false) {}

  /// Reports one thing under all names that an `expect` entry may call it by.
  void add(std::initializer_list<std::string> names, std::string text) {
    bool expected = false;
    for (std::size_t i = 0; i < expect_.size(); ++i) {
      for (const std::string& name : names) {
        if (lower_case(expect_[i]) == lower_case(name)) expected = met_[i] = true;
      }
    }
    if (expected) return;
    const auto [place, is_new] = places_.try_emplace(*names.begin(), lines_.size());
    if (is_new) {
      lines_.push_back({std::move(text), 1});
    } else {
      ++lines_[place->second].second;
    }
  }

  [[nodiscard]] Health take() {
    Health health;
    for (auto& [text, times] : lines_) {
      health.findings.push_back(times > 1 ? fmt::format("{} ({} times)", text, times) : std::move(text));
    }
    for (std::size_t i = 0; i < expect_.size(); ++i) (met_[i] ? health.expected : health.absent).push_back(expect_[i]);
    health.held = health.findings.empty();
    return health;
  }

 private:
  const std::vector<std::string>& expect_;
  std::vector<bool> met_;
  std::map<std::string, std::size_t> places_;
  std::vector<std::pair<std::string, std::size_t>> lines_;
};

void judge_ending(const record::Ending& ending, Findings& findings) {
  if (ending.reason != record::EndReason::kCompleted) {
    // No entry can say this name: read_checks() refuses it.
    findings.add({"the run ended early"},
                 fmt::format("the run ended early, at {:.6g} s ({}){}{}", to_s(ending.at),
                             record::to_text(ending.reason), ending.text.empty() ? "" : ": ", ending.text));
  }
  if (ending.lost_frames > 0) findings.add({"lost-frames"}, fmt::format("{} lost frames", ending.lost_frames));
}

void judge_events(const record::Recording& recording, Findings& findings) {
  for (const record::RecordedEvent& e : recording.events) {
    if (e.event.severity == Severity::kInfo) continue;
    findings.add(
        {e.source + "." + e.event.code},
        fmt::format("{}: {} {} at {:.6g} s: {}", e.source, e.event.severity == Severity::kFault ? "fault" : "warning",
                    e.event.code, to_s(e.event.at), e.event.text));
  }
}

/// A counter that went back to zero has still counted, so the last row in which it was not zero is what is told.
void judge_counters(const record::Recording& recording, Findings& findings) {
  for (std::size_t column = 0; column < recording.signals.size(); ++column) {
    const SignalInfo& signal = recording.signals[column];
    if (signal.kind != SignalKind::kErrorCounter) continue;
    for (std::size_t row = recording.row_count(); row-- > 0;) {
      const double value = recording.value(row, column);
      if (value == 0) continue;
      findings.add({signal.name}, fmt::format("{} = {:.6g} at {:.6g} s, must be 0", signal.name, value,
                                              to_s(recording.row_times[row])));
      break;
    }
  }
}

std::string node_name(const record::Recording& recording, std::uint32_t node_id) {
  for (const record::NodeName& node : recording.info.nodes) {
    if (node.node_id == node_id) return node.name;
  }
  return fmt::format("{}", node_id);
}

void judge_frames(const record::Recording& recording, Findings& findings) {
  constexpr std::uint32_t kEmcy = 0x080;
  for (std::size_t i = 0; i < recording.frames.size(); ++i) {
    const double at_s = to_s(recording.frames.at(i));
    if (recording.frames.is_error(i)) {
      findings.add({"error-frames"}, fmt::format("error frame {:08X} at {:.6g} s", recording.frames.id(i), at_s));
      continue;
    }
    const std::uint32_t id = recording.frames.id(i);
    if (id <= kEmcy || id > kEmcy + 0x7F || !recording.frames.is_standard_data(i, id)) continue;
    const can::CanFrame frame = recording.frames[i].frame;
    if (frame.length < 2) continue;
    const unsigned code = frame.bytes[0] | static_cast<unsigned>(frame.bytes[1]) << 8U;
    if (code == 0) continue;
    const std::uint32_t node = id - kEmcy;
    const std::string name = node_name(recording, node);
    findings.add({fmt::format("emcy:{}:{:04X}", name, code), fmt::format("emcy:{}:{:04X}", node, code),
                  fmt::format("emcy:{}:*", name), fmt::format("emcy:{}:*", node)},
                 fmt::format("EMCY {:04X} from {} at {:.6g} s", code, name, at_s));
  }
}

}  // namespace

Health HealthGate::judge(const record::Recording& recording) const {
  Findings findings{expect};
  judge_ending(recording.ending, findings);
  judge_events(recording, findings);
  judge_counters(recording, findings);
  judge_frames(recording, findings);
  return findings.take();
}

}  // namespace meltbench::check
