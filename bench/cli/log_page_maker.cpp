#include "bench/cli/log_page_maker.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

namespace meltbench::cli {
namespace {

using decode::Finding;
using decode::FindingKind;
using report::Weight;

constexpr std::size_t kMaxValues = 300'000;    // Of all plots; 4 bytes each.
constexpr std::size_t kMaxTransfers = 20'000;  // SDO frames that a dialogue can unfold to.
constexpr std::size_t kMaxDetails = 200;       // Of one dialogue.

struct KindWords {
  const char* name;
  Weight weight;
};

KindWords describe(const Finding& finding) {
  switch (finding.kind) {
    case FindingKind::kBoot:
      return finding.code == 1 ? KindWords{"boot unasked", Weight::kFault} : KindWords{"boot", Weight::kInfo};
    case FindingKind::kNmt:
      return {"NMT command", Weight::kInfo};
    case FindingKind::kState:
      return {"NMT state", Weight::kInfo};
    case FindingKind::kHeartbeatLost:
      return {"heartbeat lost", Weight::kFault};
    case FindingKind::kEmcy:
      return {"EMCY", finding.code == 0 ? Weight::kInfo : Weight::kFault};
    case FindingKind::kSdo:
      return {"SDO", Weight::kInfo};
    case FindingKind::kSdoFailed:
      return {"SDO failed", Weight::kWarning};
    case FindingKind::kSetPoint:
      return {"set point", Weight::kInfo};
    case FindingKind::kInvalid:
      return {"invalid value", Weight::kWarning};
    case FindingKind::kGap:
      return {"gap", Weight::kWarning};
    case FindingKind::kTooOften:
      return {"too often", Weight::kWarning};
    case FindingKind::kErrorFrames:
      return {"error frames", Weight::kWarning};
    case FindingKind::kErrorState:
      return {"bus state", finding.code == 1 ? Weight::kFault : Weight::kWarning};
    case FindingKind::kUnknown:
      return {"unknown frame", Weight::kWarning};
    case FindingKind::kMessage:
      return {"message", Weight::kInfo};
  }
  return {"other", Weight::kInfo};
}

KindWords describe(const decode::LineFinding& finding) {
  constexpr std::uint64_t kGone = 3;  // Requests in a row without an answer: nobody is there.
  switch (finding.kind) {
    case decode::LineFindingKind::kPolls:
      return {"polls", Weight::kInfo};
    case decode::LineFindingKind::kRefused:
      return {"refused", Weight::kWarning};
    case decode::LineFindingKind::kGarbled:
      return {"garbled bytes", Weight::kWarning};
    case decode::LineFindingKind::kNoAnswer:
      return {"no answer", finding.count >= kGone ? Weight::kFault : Weight::kWarning};
    case decode::LineFindingKind::kSilence:
      return {"silence", Weight::kFault};
  }
  return {"other", Weight::kInfo};
}

}  // namespace

LogPageMaker::LogPageMaker(const config::Rig& rig, const decode::Dbc* dbc) : rig_{rig}, story_{rig, dbc} {}

void LogPageMaker::take(Instant at, const can::CanFrame& frame) {
  at = std::max(at, story_.end());
  story_.take(at, frame);
  counter_.take(at, frame, record::kUnknownSender);
  if (const decode::DbcMessage* message = story_.view().find_message(frame)) return take_message(*message, at, frame);
  if (frame.kind != can::FrameKind::kData || frame.extended) return;
  const decode::FrameMeaning meaning = story_.view().meaning_of(frame);
  switch (meaning.service) {
    case decode::Service::kTpdo:
    case decode::Service::kRpdo:
      return take_values(meaning, at, frame);
    case decode::Service::kSdoRequest:
    case decode::Service::kSdoResponse:
      return take_transfer(meaning, at, frame);
    default:
      return;
  }
}

void LogPageMaker::take_values(const decode::FrameMeaning& meaning, Instant at, const can::CanFrame& frame) {
  for (const decode::DecodedValue& value : story_.view().values_of(frame)) {
    const std::uint32_t address = std::uint32_t{value.address.index} << 8U | value.address.sub;
    const auto [place, is_new] = lines_.try_emplace({meaning.node, address});
    Line& line = place->second;
    if (is_new) {
      line = {meaning.node, value.address, std::string{value.name}, std::nullopt};
      line.signal = signals_.add(fmt::format("{} {}", story_.view().name_of(meaning.node), value.name));
      if (!line.signal) ++signals_left_out_;
    }
    if (line.signal) signals_.take(*line.signal, at, value.value);
  }
}

void LogPageMaker::take_message(const decode::DbcMessage& message, Instant at, const can::CanFrame& frame) {
  const std::uint64_t id = std::uint64_t{message.is_extended} << 32U | message.id;
  for (const decode::DbcValue& value : decode::decode_message(message, frame.data())) {
    const auto [place, is_new] = message_lines_.try_emplace({id, value.signal});
    DbcLine& line = place->second;
    if (is_new) {
      line = {fmt::format("{}: {}", message.name, value.signal->name), value.signal->unit, std::nullopt};
      line.signal = signals_.add(line.title);
      if (!line.signal) ++signals_left_out_;
    }
    if (line.signal) signals_.take(*line.signal, at, value.value);
  }
}

void LogPageMaker::take_transfer(const decode::FrameMeaning& meaning, Instant at, const can::CanFrame& frame) {
  if (transfers_.size() < kMaxTransfers) transfers_.push_back({at, meaning.node, story_.view().describe(frame)});
}

void LogPageMaker::add(const decode::LineStory& lines) {
  for (const decode::LineFinding& finding : lines.findings()) {
    const auto [kind, weight] = describe(finding);
    of_serial_lines_.push_back({to_s(finding.at), weight, kind, "line " + finding.line, finding.text, {}});
  }
  left_out_ += lines.left_out();
}

report::LogPage LogPageMaker::finish() {
  story_.finish();
  report::LogPage page;
  std::vector<record::NodeName> nodes;
  for (const config::RigBoard& board : rig_.boards) {
    if (board.node_id != 0) nodes.push_back({board.node_id, board.name});
  }
  nodes.push_back({rig_.controller_node_id, "controller"});
  page.bus = counter_.finish(to_s(story_.end()), rig_.bus.bit_rate_bit_per_s, nodes);
  page.facts.emplace_back("frames", fmt::format("{} in {:.6f} s", story_.frames(), to_s(story_.end())));
  page.facts.emplace_back("error frames", fmt::format("{}", page.bus.error_frames));
  const decode::Load& load = story_.load();
  const float most = load.per_second.empty() ? 0.0F : std::ranges::max(load.per_second);
  page.facts.emplace_back("bus load", fmt::format("mean {:.1f} %, in the worst second {:.1f} %, at {} bit/s",
                                                  100 * load.mean, 100 * most, rig_.bus.bit_rate_bit_per_s));
  page.lines = make_lines();
  page.left_out = story_.left_out() + left_out_;
  break_lines();
  page.plots = make_plots();
  page.signals_left_out = signals_left_out_;
  return page;
}

std::vector<report::StoryLine> LogPageMaker::make_lines() {
  std::vector<report::StoryLine> lines;
  for (const Finding& finding : story_.findings()) {
    const auto [kind, weight] = describe(finding);
    report::StoryLine line{to_s(finding.at), weight, kind, {}, finding.text, {}};
    if (finding.node != 0) line.node = story_.view().name_of(finding.node);
    if (finding.kind == FindingKind::kSdo) line.details = find_transfers(finding);
    lines.push_back(std::move(line));
  }
  std::ranges::move(of_serial_lines_, std::back_inserter(lines));
  std::ranges::stable_sort(lines, {}, &report::StoryLine::at_s);
  return lines;
}

std::vector<std::string> LogPageMaker::find_transfers(const Finding& dialogue) const {
  std::vector<std::string> details;
  auto transfer = std::ranges::lower_bound(transfers_, dialogue.at, {}, &Transfer::at);
  for (; transfer != transfers_.end() && transfer->at <= dialogue.until.value_or(dialogue.at); ++transfer) {
    if (transfer->node != dialogue.node) continue;
    if (details.size() == kMaxDetails) {
      details.emplace_back("...");
      break;
    }
    details.push_back(fmt::format("{:12.6f}  {}", to_s(transfer->at), transfer->text));
  }
  return details;
}

/// A line must not go on where nothing came of a node.
void LogPageMaker::break_lines() {
  for (const Finding& finding : story_.findings()) {
    if (finding.kind != FindingKind::kHeartbeatLost && finding.kind != FindingKind::kGap) continue;
    for (const auto& [key, line] : lines_) {
      const bool is_concerned = finding.node == 0 || finding.node == line.node;
      if (is_concerned && line.signal) {
        signals_.break_line(*line.signal, finding.at, finding.until.value_or(story_.end()));
      }
    }
  }
}

report::Plots LogPageMaker::make_plots() {
  report::Plots plots;
  const std::vector<float>& loads = story_.load().per_second;
  const auto load = loads.size() > 1 ? signals_.add("bus load") : std::nullopt;
  for (std::size_t second = 0; load && second < loads.size(); ++second) {
    signals_.take(*load, Instant{static_cast<std::int64_t>(second) * 1s + 500ms},
                  100.0 * static_cast<double>(loads[second]));
  }
  signals_.fold_to(kMaxValues);
  plots.times_s = signals_.times_s();
  if (load) plots.plots.push_back({"Bus load per second", "%", {{"bus load", 0, signals_.values(*load)}}, false});
  for (auto line = lines_.begin(); line != lines_.end();) {
    const std::uint8_t node = line->second.node;
    const canopen::ObjectAddress first = line->second.address;
    const std::uint16_t index = first.index;
    const std::string who = story_.view().name_of(node);
    report::Plot plot{{}, {}, {}, true};
    bool moves = false;
    std::vector<std::string> still;
    for (; line != lines_.end() && line->second.node == node && line->second.address.index == index; ++line) {
      const auto& signal = line->second.signal;
      if (!signal) continue;
      const auto value = signals_.still_value(*signal);
      if (value) still.push_back(fmt::format("{} = {:.6g}", signals_.name(*signal), *value));
      moves = moves || !value;
      plot.title = fmt::format("{}: {}", who, line->second.name);
      plot.series.push_back({line->second.name, 0, signals_.values(*signal)});
    }
    if (plot.series.size() > 1) {
      plot.title = fmt::format("{} {:04X}h", who, index);
    } else if (!plot.series.empty()) {
      plot.series.front().signal = text(first);  // The title has the name.
    }
    if (moves) {
      plots.plots.push_back(std::move(plot));
    } else {
      plots.still.insert(plots.still.end(), still.begin(), still.end());
    }
  }
  add_message_plots(plots);
  plots.thinned = true;
  return plots;
}

void LogPageMaker::add_message_plots(report::Plots& plots) const {
  for (const auto& [key, line] : message_lines_) {
    if (!line.signal) continue;
    if (const auto value = signals_.still_value(*line.signal)) {
      plots.still.push_back(fmt::format("{} = {:.6g} {}", line.title, *value, line.unit));
    } else {
      plots.plots.push_back({line.title, line.unit, {{key.second->name, 0, signals_.values(*line.signal)}}, true});
    }
  }
}

}  // namespace meltbench::cli
