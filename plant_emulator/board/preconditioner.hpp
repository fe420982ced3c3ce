#pragma once
/// Inlet preconditioner: heats or cools the granules at the inlet, with a temperature loop of its own.

#include <bitset>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/board/sampling.hpp"
#include "plant_emulator/board/settings.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::board {

/// What the flux is made of, object 2002.
enum class InletMode : std::uint8_t {
  kOff = 0,   ///< q = 0.
  kFlux = 1,  ///< q = feedforward 2000.
  kLoop = 2,  ///< q = feedforward 2000 - gain 2001 (T - set point 6402:1), closed in the board.
};

/// Bits of object 2011.
enum PreconditionerState : std::uint8_t {
  kInletOn = 0x01,          ///< A mode other than off is at work.
  kInletMasterLost = 0x02,  ///< The flux is 0 because nobody sends set points.
  kInletAtMin = 0x04,       ///< Cut at 2004 at some time since the SYNC before.
  kInletAtMax = 0x08,       ///< Cut at 2005 at some time since the SYNC before.
  kInletNotANumber = 0x10,  ///< The last set point, feedforward or gain was refused.
};

/// The preconditioner's firmware. Objects that a controller needs (fixtures/boards/preconditioner.eds has all):
/// - 6402:1  REAL32  RPDO 1  set point of the inlet temperature [degC]
/// - 2000    REAL32  RPDO 1  feedforward flux [W/m2], positive heats
/// - 2001    REAL32  RPDO 2  gain of the inner loop [W/(m2 K)], not negative
/// - 2002    U8      RPDO 2  InletMode; off at power-up
/// - 6130:1  REAL32  TPDO 1  newest inlet temperature [degC], quantised; 6150:1 its InputStatus
/// - 2010    U16     TPDO 1  its age at the instant of the SYNC [us]; 0xFFFF: 65.535 ms or older
/// - 2011    U8      TPDO 1  PreconditionerState
/// - 2012    REAL32  TPDO 2  mean flux between the SYNC before and this one [W/m2], after cutting
/// - 6410:1  REAL32  TPDO 2  flux now [W/m2]
/// - 2004, 2005, 2006        least and largest flux [W/m2], watchdog [ms]; rw
///
/// What arrives waits for the next control cycle. The inner loop is part of the process (plant::MeltInlet): it is as
/// fast as the board's analogue electronics, so no sampled copy of it can be unstable. Watchdog: the first RPDO 1
/// starts it; if they then stop, or a heartbeat of 1016 is lost, the flux is 0, with EMCY FF01, until the next one
/// comes.
class Preconditioner final : public Board {
 public:
  static constexpr std::uint16_t kEmcySetPointsLost = 0xFF01;

  /// Parameters and @throws as Feeder.
  Preconditioner(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
                 const PreconditionerSettings& settings, Chance chance, Process& process);

  [[nodiscard]] Instant next_touch(Instant until) const override;
  void touch(Instant at) override;

  [[nodiscard]] std::span<const std::string_view> signal_names() const override;
  void settle(Instant now) override;
  void read_signals(std::span<double> values) const override;

 protected:
  void run_timers(Instant now) override;
  void refresh(Instant now) override;

  void on_sync(Instant now, std::uint8_t counter) override;
  canopen::AbortCode on_write(Instant now, const canopen::OdEntry& entry, std::span<const std::uint8_t> value) override;
  void on_written(Instant now, const canopen::OdEntry& entry) override;
  void on_rpdo(Instant now, unsigned number) override;
  void on_reset(Instant now, canopen::ResetKind kind) override;
  void on_heartbeat(Instant now, const canopen::HeartbeatEvent& event) override;

 private:
  struct Sample {
    Instant taken_at;
    double T_degC = 0;
  };

  void find_set_point_rpdos();
  void take_orders(Instant now, bool is_set_point);
  void lose_master(Instant now, std::string_view why);
  [[nodiscard]] plant::MeltInlet make_inlet() const;
  [[nodiscard]] Sample measure(Instant at);
  void make_available(Instant now);
  [[nodiscard]] std::uint8_t state() const;
  [[nodiscard]] std::uint8_t status() const;

  PreconditionerSettings settings_;
  SampleClock clock_;
  std::uint64_t noise_seed_;

  canopen::OdValue<float> set_point_, feedforward_, gain_, min_flux_, max_flux_, field_, pv_, flux_now_, mean_flux_;
  canopen::OdValue<std::uint8_t> mode_, state_, status_;
  canopen::OdValue<std::uint16_t> watchdog_ms_, age_us_;
  std::vector<bool> set_point_rpdos_;  // Which RPDOs carry 6402:1, from number 1 on.

  double T_reference_degC_ = 0, q_feedforward_ = 0, gain_W_per_m2K_ = 0;  // The last ones that were numbers.
  std::bitset<128> lost_nodes_;                                           // Whose heartbeat is lost.
  bool master_lost_ = false, not_a_number_ = false;
  bool orders_waiting_ = false;

  Instant sampled_at_ = SampleClock::kNone;
  Ring<Sample> pending_;  // Taken, not yet available.
  Sample newest_;
  Instant synced_at_{};
  plant::InletFlux at_sync_, at_sync_before_;  // Totals.
  double mean_flux_W_per_m2_ = 0;
  double settled_flux_W_per_m2_ = 0;
};

}  // namespace meltbench::board
