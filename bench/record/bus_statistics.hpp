#pragma once
/// Who talked how much and how regularly on a recorded bus.

#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "bench/record/recording.hpp"

namespace meltbench::record {

/// Traffic of one identifier. Periods are the gaps between its consecutive frames, a boot-up
/// (first frame of a node, on the identifier of its heartbeat) left out.
struct IdStatistics {
  std::uint32_t id = 0;
  bool extended = false;
  std::string name;  ///< By the CANopen predefined connection set: "TPDO1 feeder", "SYNC"; empty for others.
  std::uint64_t frames = 0;
  std::uint64_t data_bytes = 0;
  double mean_period_s = 0;  ///< 0 if fewer than two frames.
  double min_period_s = 0;
  double max_period_s = 0;
  std::optional<double> load;  ///< Share of the bus time, 0..1, without stuff bits; only if the bit rate is known.
};

struct BusStatistics {
  std::uint64_t frames = 0;  ///< Error frames not counted.
  std::uint64_t data_bytes = 0;
  std::uint64_t error_frames = 0;
  std::uint64_t lost_frames = 0;
  std::uint64_t outside_frames = 0;  ///< Of `frames`, those that a program outside the run has sent.
  std::optional<double> load;        ///< Mean over the run, as in IdStatistics. Stuffing adds up to a quarter.
  std::vector<IdStatistics> ids;     ///< Standard before extended, then by identifier.
};

[[nodiscard]] BusStatistics calc_bus_statistics(const Recording& recording);

/// The same of frames that come one by one. Memory: some 200 bytes for each identifier, of which there can be
/// kMaxIdentifiers; frames of further ones are in the sums only.
class BusCounter {
 public:
  static constexpr std::size_t kMaxIdentifiers = 10'000;

  BusCounter();
  ~BusCounter();
  BusCounter(BusCounter&&) noexcept;
  BusCounter& operator=(BusCounter&&) noexcept;

  void take(Instant at, const can::CanFrame& frame, std::uint8_t sender);
  /// To be called once. @param duration_s, bit_rate_bit_per_s  make loads known, if both are.
  [[nodiscard]] BusStatistics finish(double duration_s, std::optional<std::uint32_t> bit_rate_bit_per_s,
                                     std::span<const NodeName> nodes);

 private:
  struct Tally;
  std::map<std::pair<bool, std::uint32_t>, Tally> tallies_;
  BusStatistics sums_;
  double bits_ = 0;
};

/// Gaps between consecutive frames of one identifier [s], oldest first; those beside a boot-up are left out.
[[nodiscard]] std::vector<double> calc_periods_s(const FrameLog& frames, std::uint32_t id, bool extended);

/// Meaning of an 11-bit identifier in the CANopen predefined connection set, with the node's name where it has one:
/// "NMT", "SYNC", "EMCY feeder", "TPDO1 feeder", "SDO answer 5", "heartbeat feeder". Empty where the set says nothing.
[[nodiscard]] std::string name_cob_id(std::uint32_t cob_id, std::span<const NodeName> nodes);

}  // namespace meltbench::record
