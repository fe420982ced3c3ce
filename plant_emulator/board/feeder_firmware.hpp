#pragma once
/// Loss-in-weight feeder, whatever wire it hangs on: set points, hopper, scale, refill, totalizer and watchdog.

#include <cstdint>
#include <span>
#include <string_view>

#include "plant_emulator/board/process.hpp"
#include "plant_emulator/board/sampling.hpp"
#include "plant_emulator/board/settings.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::board {

/// Bits of the feeder's status, the same on both wires.
enum FeederStatus : std::uint8_t {
  kDelivering = 0x01,   ///< The flow is not 0.
  kMasterLost = 0x02,   ///< The flow has fallen, or is about to fall, to the one on loss of master.
  kSetPointCut = 0x04,  ///< The last set point was outside 0..max.
  kHopperEmpty = 0x08,  ///< Nothing left to deliver.
  kNotANumber = 0x10,   ///< The last set point was refused.
  kRefilling = 0x20,    ///< The refill valve is open.
  kVolumetric = 0x40,   ///< The flow is not weighed: refilling, calming down after it, or told so.
};

/// What may happen by itself, for the face that the feeder has on its wire.
class FeederListener {
 public:
  virtual ~FeederListener() = default;
  virtual void on_hopper_empty(Instant at) = 0;
  virtual void on_refill(Instant at, bool begins) = 0;
};

/// A set point waits for the next control cycle, and changes the flow one latency later. From power-up until the first
/// set point, the start flow is delivered: by default what keeps the plant in balance. The first set point starts the
/// watchdog.
///
/// *Gravimetric*: the scale says what leaves the hopper, so what is delivered is the set point, and the feed factor
/// (mass flow at 100 % drive command) is known. *Volumetric*: the drive command is held at set point / the feed factor
/// as it was last known. A fuller hopper packs the material: the true feed factor is
///
///   f(w) = f0 (1 + e (w - w_low) / (w_high - w_low)),   cut to w_low..w_high,
///
/// f0 = flow at full drive with the hopper at its low limit, e = fill_effect. So the flow delivered is then off by
/// f(w) / f(w known), and the feeder cannot see it: it reports the set point. At the low limit the refill valve opens,
/// until the high limit; gravimetric again when the scale has calmed down (refill_settle).
///
/// It touches the process as Device says. Real time: no allocation in the steady state.
class FeederFirmware {
 public:
  /// @param chance  phases of its clocks and its noise.
  FeederFirmware(const FeederSettings& settings, Chance chance, Process& process, FeederListener& listener);

  void power_up(Instant now);

  [[nodiscard]] Instant next_touch(Instant until) const;
  void touch(Instant at);
  /// Hopper, totalizer, scale and filter up to `at`.
  void move_to(Instant at);

  /// Notes whether a set point is a number. @returns true if it is.
  bool check(double set_point_kg_per_h);
  /// A set point that counts. @returns true if the master was lost until now.  @pre check().
  bool take_set_point(Instant now, double set_point_kg_per_h, std::uint16_t watchdog_ms);
  /// The flow goes to the one on loss of master. @returns false if it was lost already.
  bool lose_master(Instant now, double flow_kg_per_h);
  /// When the watchdog bites; never() while it does not run.
  [[nodiscard]] Instant watchdog_at() const { return watchdog_at_; }
  /// Another watchdog time, if it runs. 0 = off.
  void change_watchdog(Instant now, std::uint16_t watchdog_ms);

  /// Stopped it delivers nothing, but keeps the set point.
  void set_running(Instant now, bool running);
  /// Asks for volumetric feeding; the refill does so by itself.
  void set_volumetric(Instant now, bool volumetric);
  /// Opens the refill valve. @returns false if there is none, or the hopper is full.
  bool begin_refill(Instant now);
  /// @pre 0 <= low < high, or both 0: no refill.
  void set_refill_limits(Instant now, double low_kg, double high_kg);
  void clear_totalizer() { delivered_kg_ = 0; }
  void tare() { tare_kg_ = static_cast<float>(weight_kg_); }

  [[nodiscard]] std::uint8_t status() const;
  [[nodiscard]] bool is_running() const { return running_; }
  [[nodiscard]] bool is_refilling() const { return refilling_; }
  [[nodiscard]] bool is_volumetric() const { return volumetric_; }
  [[nodiscard]] bool is_told_volumetric() const { return told_volumetric_; }
  [[nodiscard]] double set_point_kg_per_h() const { return set_point_kg_per_h_; }  ///< The last one that was a number.
  [[nodiscard]] float flow_kg_per_h() const { return flow_kg_per_h_; }  ///< Delivered now, as far as it knows.
  [[nodiscard]] Nanos flow_age(Instant now) const { return now - changed_at_; }
  [[nodiscard]] std::uint8_t changes() const { return change_count_; }  ///< Of the flow, modulo 256.
  [[nodiscard]] double measured_kg_per_h() const { return filtered_kg_per_h_; }
  [[nodiscard]] double weight_kg() const { return weight_kg_; }
  [[nodiscard]] float tare_kg() const { return tare_kg_; }
  [[nodiscard]] double totalizer_kg() const { return delivered_kg_; }
  /// As far as it knows.
  [[nodiscard]] double feed_factor_kg_per_h() const {
    return volumetric_ ? held_factor_kg_per_h_ : true_factor_kg_per_h();
  }
  [[nodiscard]] double drive_command_percent() const;
  [[nodiscard]] double refill_low_kg() const { return settings_.refill_low_kg; }
  [[nodiscard]] double refill_high_kg() const { return settings_.refill_high_kg; }
  [[nodiscard]] const FeederSettings& settings() const { return settings_; }

  /// The same on both wires, see read_signals().
  [[nodiscard]] static std::span<const std::string_view> signal_names();
  void read_signals(std::span<double> values) const;

  static constexpr Nanos kAgeUnit = 10us;  ///< Of flow_age() on the wire.

 private:
  struct Change {
    Instant at;
    float flow_kg_per_h = 0;
  };
  void schedule(Instant now, double flow_kg_per_h);
  void deliver(Instant at, float flow_kg_per_h);
  void drive();
  void follow_refill(Instant at);
  void run_dry(Instant at);
  void set_mode(Instant at);
  void sample_weight(Instant until);
  [[nodiscard]] double true_factor_kg_per_h() const;
  [[nodiscard]] double fed_kg_per_s() const;  ///< What leaves the hopper in truth.
  [[nodiscard]] double net_kg_per_s() const;
  [[nodiscard]] Instant falls_to(double weight_kg) const;
  [[nodiscard]] Instant empty_at() const { return empty_ ? Instant::never() : falls_to(0); }
  [[nodiscard]] Instant low_at() const;

  FeederSettings settings_;
  SampleClock control_clock_;
  SampleClock weight_clock_;
  std::uint64_t noise_seed_;
  Process& process_;
  FeederListener& listener_;

  Ring<Change> pending_;
  float scheduled_kg_per_h_ = 0;  // The newest that has been scheduled.
  float flow_kg_per_h_ = 0;       // Delivered now, as the firmware has it,
  double true_kg_per_h_ = 0;      // and in truth.
  Instant changed_at_{Nanos::min() / 2};
  std::uint8_t change_count_ = 0;
  double set_point_kg_per_h_ = 0;
  Instant watchdog_at_ = Instant::never();
  bool running_ = true, master_lost_ = false, cut_ = false, not_a_number_ = false, empty_ = false;
  bool ran_dry_ = false;  // The process says that nothing is left, whatever should be.

  bool told_volumetric_ = false, volumetric_ = false, refilling_ = false;
  Instant calm_at_{};                // After a refill: gravimetric again.
  double held_factor_kg_per_h_ = 0;  // While volumetric.

  Instant moved_to_{};  // Hopper, totalizer and filter are as of then.
  double hopper_kg_;
  double delivered_kg_ = 0;
  double filtered_kg_per_h_ = 0;
  Instant weighed_at_ = SampleClock::kNone;
  double weight_kg_;
  float tare_kg_ = 0;
};

}  // namespace meltbench::board
