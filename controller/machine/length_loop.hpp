#pragma once
/// The loop that holds the filled length: samples of the boards in, feed command out. It does not know of CAN.

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "controller/estimator/length_model.hpp"
#include "controller/law/delay_law.hpp"
#include "controller/machine/feed_tracker.hpp"
#include "controller/machine/settings.hpp"

namespace meltbench::machine {

/// What the boards say about themselves at boot.
struct BoardFacts {
  double metres_per_increment = 0.01 / 65536.0;  ///< Conveyed per encoder increment.
  double Pa_per_count = 1.0;
  Nanos feeder_latency{};
  Nanos feeder_cycle{};
  Nanos pressure_latency{};
  Nanos pressure_period{};
};

/// The screw at the instant of a SYNC.
struct ScrewSample {
  Instant at;
  std::int32_t position_inc = 0;  ///< Wraps.
  std::int32_t velocity_inc_per_s = 0;
};

/// What the pressure transmitter had at a SYNC.
struct PressureSample {
  Instant sync_at;
  std::int32_t counts = 0;
  std::optional<Nanos> age;  ///< At the SYNC; nothing: older than can be told.
  bool good = false;         ///< By its status.
};

/// Speed of the screw or a length over time, from time-stamped samples; linear in between.
class SampleRecord {
 public:
  explicit SampleRecord(std::size_t samples) : samples_(samples) {}
  /// Ignored if not newer than the newest.
  void add(Instant at, double value);
  /// Before the oldest sample: as that one; after the newest: with its slope, for at most kMaxLookahead. @pre !empty().
  [[nodiscard]] double at(Instant at) const;
  [[nodiscard]] bool empty() const { return samples_.empty(); }

  static constexpr Nanos kMaxLookahead = 50ms;

 private:
  struct Sample {
    Instant at;
    double value = 0.0;
  };
  Ring<Sample> samples_;
};

/// What is asked of the feeder, and what it was chosen for.
struct LengthCommand {
  double U = 0.0;
  double P_m = 0.0;
  double flow_kg_per_s = 0.0;  ///< rho0 S_eff c U with the speed expected while it is in effect.
  law::PredictionStatus status = law::PredictionStatus::kOk;
};

/// Estimator, material clock, feed history and law, put together in the order that they need each other.
/// Per SYNC: add() what has come, then calc() once. Real time: no allocation, about 0.3 us.
class LengthLoop {
 public:
  /// Makes one law per set point, and feeds all of them: a change of set point then needs no history to be repeated.
  /// @throws std::invalid_argument if a law cannot be made from the settings.
  LengthLoop(const ControllerSettings& settings, const BoardFacts& facts);

  void add(const ScrewSample& sample);
  void add(const FeedSample& sample);
  void add(const PressureSample& sample);

  /// The viscosity of the melt at the nozzle, for the pressures to come.
  void note_viscosity(double viscosity_Pa_s) { model_.viscosity_Pa_s = viscosity_Pa_s; }

  /// Starts the laws on a screw that has been fed nothing, instead of the balance that calc() would begin with.
  /// Ignored while screw and feeder have not been heard.
  void start_empty();
  /// The next calc() or start_empty() starts the laws anew.
  void stop() { started_ = false; }
  /// The laws begin with what the feeder delivers now, as after a fault, and not with a balance.
  void start_from_feed() { from_feed_ = true; }

  /// All three boards have been heard and a first estimate exists.
  [[nodiscard]] bool is_ready() const;

  /// The command for a SYNC. Before law_starts_at it holds the filled length of the start. @pre is_ready().
  [[nodiscard]] LengthCommand calc(Instant sync_at, Instant now);

  /// Has been sent; also what did not come from calc().
  void note_sent(Instant now, double flow_kg_per_s) { feed_.command(now, flow_kg_per_s); }

  /// @param index  into the settings' set points.
  void select_set_point(std::size_t index) { selected_ = index; }

  [[nodiscard]] bool has_estimate() const { return measured_; }
  [[nodiscard]] double x_m() const { return x_m_; }                       ///< Newest usable estimate.
  [[nodiscard]] double newest_x_m() const { return newest_x_m_; }         ///< Whether it fits to what was fed or not.
  [[nodiscard]] Instant measured_at() const { return measured_at_; }      ///< Its time stamp.
  [[nodiscard]] double pressure_Pa() const { return pressure_Pa_; }       ///< Newest, usable or not.
  [[nodiscard]] bool is_pressure_good() const { return pressure_good_; }  ///< By its status.
  [[nodiscard]] double speed_m_per_s() const { return speed_m_per_s_; }   ///< At the newest screw sample.
  [[nodiscard]] double U_applied() const;                                 ///< As the feeder reports it.
  [[nodiscard]] Instant screw_at() const { return screw_at_; }
  [[nodiscard]] Instant feed_at() const { return feed_.known_until().value_or(Instant{}); }
  /// Since when pressures have come that cannot be used; nothing if the newest is good.
  [[nodiscard]] std::optional<Instant> implausible_since() const { return implausible_since_; }
  /// Since when the pressure has not fitted to what was fed: such samples are not used. Nothing: it fits.
  [[nodiscard]] std::optional<Instant> disagrees_since() const { return disagrees_since_; }

 private:
  void start_laws(double U);
  [[nodiscard]] bool fits_balance(Instant at, double x_m) const;
  [[nodiscard]] Instant time_stamp_of(const PressureSample& sample) const;

  law::BizoneModel model_;
  BoardFacts facts_;
  Nanos sync_period_;
  bool time_stamped_;
  Instant law_starts_at_;
  std::vector<std::unique_ptr<law::DelayLaw>> laws_;  // One per set point.
  std::size_t selected_ = 0;
  bool started_ = false;
  bool from_feed_ = false;
  double start_U_ = 0.0;

  std::optional<law::MaterialClock> clock_;
  SampleRecord speeds_;
  estimator::LengthModel balance_;
  SampleRecord balances_;
  double max_disagreement_m_;
  FeedTracker feed_;
  std::int64_t travelled_inc_ = 0;
  std::int32_t last_position_inc_ = 0;

  double speed_m_per_s_ = 0.0;
  double x_m_ = 0.0;
  double newest_x_m_ = 0.0;
  double pressure_Pa_ = 0.0;
  bool pressure_good_ = false;
  bool measured_ = false;
  Instant measured_at_;
  Instant screw_at_;
  std::optional<Instant> implausible_since_;
  std::optional<Instant> disagrees_since_;
};

}  // namespace meltbench::machine
