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
#include "plant_emulator/board/feeder_firmware.hpp"

namespace meltbench::board {

/// The feeder on CAN. The objects of it that a controller needs (fixtures/boards/feeder.eds has all):
/// - 2000  REAL32  RPDO 1  set point [kg/h]; not a number is refused, a value outside 0..2009 is cut
/// - 2001  REAL32  TPDO 1  flow delivered now [kg/h], after latency, limit and resolution
/// - 2002  U16     TPDO 1  for how long it has been so [10 us]; 0xFFFF: 0.655 s or longer
/// - 2003  U8      TPDO 1  FeederStatus
/// - 2004  U8      TPDO 1  changes of the delivered flow, modulo 256
/// - 2005  REAL32  rw      flow on loss of master [kg/h]
/// - 2006  U16     rw      watchdog [ms], 0 = off
/// - 2007  U32     ro      latency [us] from control cycle to flow; a set point waits up to 200A us before that
/// - 2008  REAL32  ro      totalizer [kg]
///
/// TPDO 1 is synchronous (type 1): from two of them a master knows the flow at every instant between, if 2004 differs
/// by no more than 1: before t_SYNC - age it was what the earlier one said.
///
/// What it does is in FeederFirmware. NMT reset node is a power-up. If set points stop, or a heartbeat in 0x1016 is
/// lost, the flow goes to 2005, with EMCY FF01 (or the node's 8130), and comes back with the next set point; while a
/// heartbeat is lost, set points do not count. An empty hopper is EMCY FF02.
/// Neither leaving Operational nor being stopped touches the flow itself: set points then stop, which the watchdog
/// sees.
class Feeder final : public Board, private FeederListener {
 public:
  static constexpr std::uint16_t kEmcySetPointsLost = 0xFF01;
  static constexpr std::uint16_t kEmcyHopperEmpty = 0xFF02;

  /// @param dictionary  of its EDS.  @param chance  phases of its clocks and its noise.
  /// @throws std::out_of_range, std::invalid_argument if the dictionary lacks an object or has it with another type.
  Feeder(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
         const FeederSettings& settings, Chance chance, Process& process);

  [[nodiscard]] Instant next_touch(Instant until) const override { return firmware_.next_touch(until); }
  void touch(Instant at) override;

  [[nodiscard]] std::span<const std::string_view> signal_names() const override {
    return FeederFirmware::signal_names();
  }
  void settle(Instant now) override { firmware_.move_to(now); }
  void read_signals(std::span<double> values) const override { firmware_.read_signals(values); }

  [[nodiscard]] double flow_kg_per_h() const { return firmware_.flow_kg_per_h(); }

 protected:
  void run_timers(Instant now) override;
  void refresh(Instant now) override;

  canopen::AbortCode on_write(Instant now, const canopen::OdEntry& entry, std::span<const std::uint8_t> value) override;
  void on_written(Instant now, const canopen::OdEntry& entry) override;
  void on_rpdo(Instant now, unsigned number) override;
  void on_reset(Instant now, canopen::ResetKind kind) override;
  void on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) override;

 private:
  void on_hopper_empty(Instant at) override;
  void on_refill(Instant at, bool begins) override;
  void find_set_point_rpdos();
  void take_set_point(Instant now);
  void lose_master(Instant now, std::string_view why);

  FeederFirmware firmware_;
  canopen::OdValue<float> set_point_, delivered_, on_loss_, totalizer_, weight_pv_, flow_pv_, tare_, net_weight_;
  canopen::OdValue<std::uint16_t> age_, watchdog_ms_;
  canopen::OdValue<std::uint8_t> status_, changes_, weight_status_, flow_status_;
  canopen::OdValue<std::int32_t> weight_count_, flow_count_;
  std::vector<bool> set_point_rpdos_;  // Which RPDOs carry 2000, from number 1 on.
  std::bitset<128> lost_nodes_;        // Whose heartbeat is lost.
};

}  // namespace meltbench::board
