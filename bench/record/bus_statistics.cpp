#include "bench/record/bus_statistics.hpp"

#include <fmt/format.h>

#include <algorithm>
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

/// The six services of the predefined connection set that a node has one to four of, by the upper four bits.
std::string_view name_service(std::uint32_t function_code) {
  constexpr std::array<std::string_view, 16> kServices{
      "",      "EMCY",  "",      "TPDO1",      "RPDO1",       "TPDO2", "RPDO2",     "TPDO3",
      "RPDO3", "TPDO4", "RPDO4", "SDO answer", "SDO request", "",      "heartbeat", ""};
  return kServices.at(function_code & 0xFU);
}

}  // namespace

/// What is counted of one identifier.
struct BusCounter::Tally {
  void take(Instant at, const can::CanFrame& frame) {
    if (const auto period_s = gaps.take(at, frame)) {
      statistics.min_period_s = periods == 0 ? *period_s : std::min(statistics.min_period_s, *period_s);
      statistics.max_period_s = std::max(statistics.max_period_s, *period_s);
      periods_sum_s += *period_s;
      ++periods;
    }
    ++statistics.frames;
    statistics.data_bytes += frame.data().size();
    bits += calc_frame_bits(frame);
  }

  IdStatistics statistics;
  Gaps gaps;
  std::uint64_t periods = 0;
  double periods_sum_s = 0;
  double bits = 0;
};

BusCounter::BusCounter() = default;
BusCounter::~BusCounter() = default;
BusCounter::BusCounter(BusCounter&&) noexcept = default;
BusCounter& BusCounter::operator=(BusCounter&&) noexcept = default;

void BusCounter::take(Instant at, const can::CanFrame& frame, std::uint8_t sender) {
  if (frame.kind == can::FrameKind::kError) {
    ++sums_.error_frames;
    return;
  }
  ++sums_.frames;
  sums_.data_bytes += frame.data().size();
  bits_ += calc_frame_bits(frame);
  if (sender == kTapSender) ++sums_.outside_frames;
  const std::pair key{frame.extended, frame.id};
  if (tallies_.size() >= kMaxIdentifiers && !tallies_.contains(key)) return;
  tallies_[key].take(at, frame);
}

BusStatistics BusCounter::finish(double duration_s, std::optional<std::uint32_t> bit_rate_bit_per_s,
                                 std::span<const NodeName> nodes) {
  const bool load_known = bit_rate_bit_per_s && duration_s > 0;
  const double bits_of_run = load_known ? duration_s * static_cast<double>(*bit_rate_bit_per_s) : 1.0;
  for (auto& [key, tally] : tallies_) {
    IdStatistics& s = tally.statistics;
    std::tie(s.extended, s.id) = key;
    if (!s.extended) s.name = name_cob_id(s.id, nodes);
    if (tally.periods > 0) s.mean_period_s = tally.periods_sum_s / static_cast<double>(tally.periods);
    if (load_known) s.load = tally.bits / bits_of_run;
    sums_.ids.push_back(std::move(s));
  }
  if (load_known) sums_.load = bits_ / bits_of_run;
  return std::move(sums_);
}

BusStatistics calc_bus_statistics(const Recording& recording) {
  BusCounter counter;
  for (std::size_t i = 0; i < recording.frames.size(); ++i) {
    const RecordedFrame recorded = recording.frames[i];
    counter.take(recorded.at, recorded.frame, recorded.sender);
  }
  BusStatistics result =
      counter.finish(to_s(recording.ending.at), recording.info.bit_rate_bit_per_s, recording.info.nodes);
  result.lost_frames = recording.ending.lost_frames;
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
