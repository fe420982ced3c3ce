#include "bench/record/bus_statistics.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <tuple>
#include <utility>

namespace meltbench::record {
namespace {

/// Bits of a classic frame from start of frame to the end of the interframe space, without stuff bits (ISO 11898-1):
/// standard 1 + 11 + RTR, IDE, r0 + 4 + data + 15 + 3 + 7 + 3 = 47 + data; extended 20 more.
/// FD frames are not counted by their two bit rates here.
double calc_frame_bits(const can::CanFrame& frame) {
  return (frame.extended ? 67.0 : 47.0) + 8.0 * static_cast<double>(frame.data().size());
}

/// A node that boots: it comes on the identifier of the heartbeat, and is none.
bool is_boot_up(const can::CanFrame& frame) {
  return frame.kind == can::FrameKind::kData && !frame.extended && frame.id >> 7U == 0x0E && frame.length == 1 &&
         frame.bytes[0] == 0;
}

/// Gaps between the frames of one identifier; to and from a boot-up there is none.
class Gaps {
 public:
  /// @returns the gap that this frame closes.
  std::optional<double> take(Instant at, const can::CanFrame& frame) {
    std::optional<double> gap_s;
    if (previous_ && !is_boot_up(frame)) gap_s = to_s(at - *previous_);
    previous_.reset();
    if (!is_boot_up(frame)) previous_ = at;
    return gap_s;
  }

 private:
  std::optional<Instant> previous_;
};

struct Tally {
  IdStatistics statistics;
  Gaps gaps;
  std::uint64_t periods = 0;
  double periods_sum_s = 0;
  double bits = 0;
};

void count(Tally& tally, const RecordedFrame& recorded) {
  IdStatistics& s = tally.statistics;
  if (const auto period_s = tally.gaps.take(recorded.at, recorded.frame)) {
    s.min_period_s = tally.periods == 0 ? *period_s : std::min(s.min_period_s, *period_s);
    s.max_period_s = std::max(s.max_period_s, *period_s);
    tally.periods_sum_s += *period_s;
    ++tally.periods;
  }
  ++s.frames;
  s.data_bytes += recorded.frame.data().size();
  tally.bits += calc_frame_bits(recorded.frame);
}

/// The six services of the predefined connection set that a node has one to four of, by the upper four bits.
std::string_view name_service(std::uint32_t function_code) {
  constexpr std::array<std::string_view, 16> kServices{
      "",      "EMCY",  "",      "TPDO1",      "RPDO1",       "TPDO2", "RPDO2",     "TPDO3",
      "RPDO3", "TPDO4", "RPDO4", "SDO answer", "SDO request", "",      "heartbeat", ""};
  return kServices.at(function_code & 0xFU);
}

}  // namespace

BusStatistics calc_bus_statistics(const Recording& recording) {
  BusStatistics result;
  result.lost_frames = recording.ending.lost_frames;
  std::map<std::pair<bool, std::uint32_t>, Tally> tallies;
  for (std::size_t i = 0; i < recording.frames.size(); ++i) {
    const RecordedFrame recorded = recording.frames[i];
    if (recorded.frame.kind == can::FrameKind::kError) {
      ++result.error_frames;
      continue;
    }
    if (recorded.sender == kTapSender) ++result.outside_frames;
    count(tallies[{recorded.frame.extended, recorded.frame.id}], recorded);
  }

  const double run_s = to_s(recording.ending.at);
  const bool load_known = recording.info.bit_rate_bit_per_s && run_s > 0;
  const double bits_of_run = load_known ? run_s * static_cast<double>(*recording.info.bit_rate_bit_per_s) : 1.0;
  double bits = 0;
  for (auto& [key, tally] : tallies) {
    IdStatistics& s = tally.statistics;
    std::tie(s.extended, s.id) = key;
    if (!s.extended) s.name = name_cob_id(s.id, recording.info.nodes);
    if (tally.periods > 0) s.mean_period_s = tally.periods_sum_s / static_cast<double>(tally.periods);
    if (load_known) s.load = tally.bits / bits_of_run;
    bits += tally.bits;
    result.frames += s.frames;
    result.data_bytes += s.data_bytes;
    result.ids.push_back(std::move(s));
  }
  if (load_known) result.load = bits / bits_of_run;
  return result;
}

std::vector<double> calc_periods_s(const FrameLog& frames, std::uint32_t id, bool extended) {
  std::vector<double> periods;
  Gaps gaps;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (frames.id(i) != id) continue;
    const RecordedFrame recorded = frames[i];
    if (recorded.frame.extended != extended || recorded.frame.kind == can::FrameKind::kError) continue;
    if (const auto period_s = gaps.take(recorded.at, recorded.frame)) periods.push_back(*period_s);
  }
  return periods;
}

std::string name_cob_id(std::uint32_t cob_id, std::span<const NodeName> nodes) {
  if (cob_id == 0x000) return "NMT";
  if (cob_id == 0x080) return "SYNC";
  if (cob_id == 0x100) return "TIME";
  const std::uint32_t node_id = cob_id & 0x7FU;
  const std::string_view service = name_service(cob_id >> 7U);
  if (service.empty() || node_id == 0) return {};
  const auto node = std::find_if(nodes.begin(), nodes.end(), [&](const NodeName& n) { return n.node_id == node_id; });
  return node == nodes.end() ? fmt::format("{} {}", service, node_id) : fmt::format("{} {}", service, node->name);
}

}  // namespace meltbench::record
