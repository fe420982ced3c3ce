#pragma once
/// What a bit-timed bus has counted in a run. Kept in the recording, because a log of frames does not show it.

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include <nlohmann/json_fwd.hpp>

namespace meltbench::record {

/// How long frames of one identifier took, from being queued by their node.
struct ResponseTiming {
  std::uint32_t id = 0;
  bool extended = false;
  std::string node;  ///< That sent them.
  std::uint64_t frames = 0;
  double mean_delay_s = 0;  ///< To the start of frame that came through.
  double worst_delay_s = 0;
  double worst_response_s = 0;    ///< To the end of the frame.
  std::optional<double> bound_s;  ///< Worst response by analysis of the rig, in operation and without errors.
};

/// A node's counters, as `ip -details -statistics link show` names them.
struct NodeTiming {
  std::string name;
  std::string state;  ///< At the end: "error-active", "error-passive", "bus-off".
  std::uint64_t tec = 0, rec = 0;
  std::uint64_t tx_packets = 0, tx_bytes = 0, tx_dropped = 0;
  std::uint64_t rx_packets = 0, rx_bytes = 0;
  std::uint64_t bus_errors = 0, arbit_lost = 0, error_warn = 0, error_pass = 0, bus_off = 0, re_started = 0;
};

struct BusTiming {
  double load = 0;  ///< Share of the run in which the wire was not idle, errors and interframe spaces included.
  std::vector<ResponseTiming> responses;  ///< Standard before extended, then by identifier.
  std::vector<NodeTiming> nodes;
};

void to_json(nlohmann::ordered_json& json, const BusTiming& timing);
/// @throws nlohmann::json::exception if something is missing.
void from_json(const nlohmann::json& json, BusTiming& timing);

}  // namespace meltbench::record
