#include "bench/cli/bus_timing.hpp"

#include <algorithm>

#include "bench/bus/response_time.hpp"
#include "controller/machine/traffic.hpp"
#include "protocols/can/frame_bits.hpp"

namespace meltbench::cli {
namespace {

using Cause = machine::PlannedFrame::Cause;
using Bounds = std::vector<std::optional<Nanos>>;

/// Latest response of the frames with this cause; nothing if one of them has no bound.
std::optional<Nanos> find_latest(const std::vector<machine::PlannedFrame>& traffic, const Bounds& bounds,
                                 auto&& chosen) {
  Nanos latest{};
  for (std::size_t i = 0; i < traffic.size(); ++i) {
    if (!chosen(traffic[i])) continue;
    if (!bounds[i]) return std::nullopt;
    latest = std::max(latest, *bounds[i]);
  }
  return latest;
}

std::string_view to_text(can::ErrorState state) {
  switch (state) {
    case can::ErrorState::kPassive:
      return "error-passive";
    case can::ErrorState::kBusOff:
      return "bus-off";
    case can::ErrorState::kActive:
      break;
  }
  return "error-active";
}

record::NodeTiming describe_node(const std::string& name, const bus::BusNode& node) {
  const bus::NodeCounters& c = node.counters();
  return {name,         std::string{to_text(node.state())},
          node.tec(),   node.rec(),
          c.tx_packets, c.tx_bytes,
          c.tx_dropped, c.rx_packets,
          c.rx_bytes,   c.bus_errors,
          c.arbit_lost, c.error_warn,
          c.error_pass, c.bus_off,
          c.re_started};
}

}  // namespace

ResponseBounds calc_bounds(const config::RigBus& bus, const machine::ControllerSettings& settings) {
  if (bus.tx_order != config::RigTxOrder::kPriority) return {};
  const Nanos bit_time{1'000'000'000 / bus.bit_rate_bit_per_s};
  const std::vector<machine::PlannedFrame> traffic = machine::plan_traffic(settings);
  std::vector<bus::PeriodicFrame> frames;
  for (const machine::PlannedFrame& planned : traffic) {
    frames.push_back({can::arbitration_key(planned.frame),
                      can::calc_longest_frame(planned.frame).nominal_bits * bit_time, planned.period, Nanos{}});
  }
  // Jitters depend on bounds and bounds on jitters: both only grow, so that this ends.
  constexpr int kMaxRounds = 100;
  Bounds bounds;
  for (int round = 0; round < kMaxRounds; ++round) {
    bounds = bus::calc_response_bounds(frames, bit_time);
    const auto sync = find_latest(traffic, bounds, [](const auto& planned) { return planned.frame.id == 0x080; });
    const auto answers =
        find_latest(traffic, bounds, [](const auto& planned) { return planned.cause == Cause::kSync; });
    if (!sync || !answers) break;
    bool settled = true;
    for (std::size_t i = 0; i < traffic.size(); ++i) {
      const Nanos jitter = traffic[i].cause == Cause::kSync    ? *sync
                           : traffic[i].cause == Cause::kCycle ? *sync + *answers
                                                               : Nanos{};
      settled = settled && jitter == frames[i].jitter;
      frames[i].jitter = jitter;
    }
    if (settled) break;
  }
  ResponseBounds result;
  for (std::size_t i = 0; i < traffic.size(); ++i) {
    if (bounds[i]) result[traffic[i].frame.id] = *bounds[i];
  }
  return result;
}

record::BusTiming describe(bus::BitTimedMedium& medium, Nanos duration, const ResponseBounds& bounds) {
  record::BusTiming timing;
  timing.load = duration > Nanos{} ? to_s(medium.bus().busy()) / to_s(duration) : 0.0;
  for (const bus::ResponseTally& tally : medium.responses()) {
    record::ResponseTiming response;
    response.id = tally.id;
    response.extended = tally.extended;
    response.node = medium.node_names()[tally.node];
    response.frames = tally.frames;
    const double count = tally.frames > 0 ? static_cast<double>(tally.frames) : 1.0;
    response.mean_delay_s = to_s(tally.sum_delay) / count;
    response.worst_delay_s = to_s(tally.worst_delay);
    response.worst_response_s = to_s(tally.worst_response);
    const auto bound = bounds.find(tally.id);
    if (!tally.extended && bound != bounds.end()) response.bound_s = to_s(bound->second);
    timing.responses.push_back(std::move(response));
  }
  for (std::size_t i = 0; i < medium.node_names().size(); ++i) {
    const bus::BusNode& node = medium.bus().node(i);
    const std::string& name = medium.node_names()[i];
    const bool may_be_away = name == bus::BitTimedMedium::kStranger || name == bus::BitTimedMedium::kTwin;
    if (may_be_away && node.counters().tx_packets == 0 && node.counters().bus_errors == 0) continue;
    timing.nodes.push_back(describe_node(name, node));
  }
  return timing;
}

}  // namespace meltbench::cli
