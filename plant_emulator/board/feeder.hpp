#pragma once
/// Loss-in-weight feeder: takes a mass-flow set point, delivers it, and says exactly what it delivers since when.

#include <array>
#include <bitset>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/board/sampling.hpp"
#include "plant_emulator/board/settings.hpp"
#include "plant_emulator/model/ring.hpp"

namespace meltbench::board {

/// Bits of object 2003. The objects of the feeder that a controller needs (fixtures/boards/feeder.eds has all):
/// - 2000  REAL32  RPDO 1  set point [kg/h]; not a number is refused, a value outside 0..2009 is cut
/// - 2001  REAL32  TPDO 1  flow delivered now [kg/h], after latency, limit and resolution
/// - 2002  U16     TPDO 1  for how long it has been so [10 us]; 0xFFFF: 0.655 s or longer
/// - 2003  U8      TPDO 1  these bits
/// - 2004  U8      TPDO 1  changes of the delivered flow, modulo 256
/// - 2005  REAL32  rw      flow on loss of master [kg/h]
/// - 2006  U16     rw      watchdog [ms], 0 = off
/// - 2007  U32     ro      latency [us] from control cycle to flow; a set point waits up to 200A us before that
/// - 2008  REAL32  ro      totalizer [kg]
///
/// TPDO 1 is synchronous (type 1): from two of them a master knows the flow at every instant between, if 2004 differs
/// by no more than 1: before t_SYNC - age it was what the earlier one said.
enum FeederStatus : std::uint8_t {
  kDelivering = 0x01,   ///< 2001 is not 0.
  kMasterLost = 0x02,   ///< The flow has fallen, or is about to fall, to 2005.
  kSetPointCut = 0x04,  ///< The last set point was outside 0..2009.
  kHopperEmpty = 0x08,  ///< Nothing left to deliver.
  kNotANumber = 0x10,   ///< The last set point was refused.
};

/// The feeder's firmware.
///
/// A set point waits for the next control cycle, and changes the flow one latency later. From power-up (and NMT reset
/// node) until the first set point, the start flow is delivered: by default what keeps the plant in balance. The first
/// set point starts the watchdog. If set points then stop, or a heartbeat in 0x1016 is lost, the flow goes the same way
/// to 2005, with EMCY FF01 (or the node's 8130), and comes back with the next set point; while a heartbeat is lost, set
/// points do not count. The hopper empties by what is delivered; empty: flow 0, EMCY FF02.
/// Neither leaving Operational nor being stopped touches the flow itself: set points then stop, which the watchdog
/// sees.
class Feeder final : public Board {
 public:
  static constexpr std::uint16_t kEmcySetPointsLost = 0xFF01;
  static constexpr std::uint16_t kEmcyHopperEmpty = 0xFF02;

  /// @param dictionary  of its EDS.  @param chance  phases of its clocks and its noise.
  /// @throws std::out_of_range, std::invalid_argument if the dictionary lacks an object or has it with another type.
  Feeder(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
         const FeederSettings& settings, Chance chance, Process& process);

  [[nodiscard]] Instant next_touch(Instant until) const override;
  void touch(Instant at) override;

  [[nodiscard]] std::span<const std::string_view> signal_names() const override;
  void settle(Instant now) override { move_to(now); }
  void read_signals(std::span<double> values) const override;

  [[nodiscard]] double flow_kg_per_h() const { return flow_kg_per_h_; }

 protected:
  void run_timers(Instant now) override;
  void refresh(Instant now) override;

  canopen::AbortCode on_write(Instant now, const canopen::OdEntry& entry, std::span<const std::uint8_t> value) override;
  void on_written(Instant now, const canopen::OdEntry& entry) override;
  void on_rpdo(Instant now, unsigned number) override;
  void on_reset(Instant now, canopen::ResetKind kind) override;
  void on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) override;

 private:
  struct Change {
    Instant at;
    float flow_kg_per_h = 0;
  };

  void power_up(Instant now);
  void find_set_point_rpdos();
  void take_set_point(Instant now);
  void lose_master(Instant now, std::string_view why);
  void schedule(Instant now, double flow_kg_per_h);
  void deliver(Instant at, float flow_kg_per_h);
  void move_to(Instant at);
  void sample_weight(Instant until);
  [[nodiscard]] Instant empty_at() const;
  [[nodiscard]] std::uint8_t status() const;

  FeederSettings settings_;
  SampleClock control_clock_;
  SampleClock weight_clock_;
  std::uint64_t noise_seed_;

  canopen::OdValue<float> set_point_, delivered_, on_loss_, totalizer_, weight_pv_, flow_pv_, tare_, net_weight_;
  canopen::OdValue<std::uint16_t> age_, watchdog_ms_;
  canopen::OdValue<std::uint8_t> status_, changes_, weight_status_, flow_status_;
  canopen::OdValue<std::int32_t> weight_count_, flow_count_;
  std::vector<bool> set_point_rpdos_;  // Which RPDOs carry 2000, from number 1 on.

  plant::Ring<Change> pending_;
  float scheduled_kg_per_h_ = 0;  // The newest that has been scheduled.
  float flow_kg_per_h_ = 0;       // Delivered now.
  Instant changed_at_{Nanos::min() / 2};
  std::uint8_t change_count_ = 0;
  std::bitset<128> lost_nodes_;    // Whose heartbeat is lost.
  double set_point_kg_per_h_ = 0;  // The last one that was a number.
  bool master_lost_ = false, cut_ = false, not_a_number_ = false, empty_ = false;

  Instant moved_to_{};  // Hopper, totalizer and filter are as of then.
  double hopper_kg_;
  double delivered_kg_ = 0;
  double filtered_kg_per_h_ = 0;
  Instant weighed_at_ = SampleClock::kNone;
  double weight_kg_;
};

}  // namespace meltbench::board
