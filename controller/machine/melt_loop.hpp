#pragma once
/// The loop that holds the melting front: samples of the boards in, request to the inlet preconditioner out. It does
/// not know of CAN.

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "controller/estimator/melt_observer.hpp"
#include "controller/law/melt_law.hpp"
#include "controller/law/melt_reference.hpp"
#include "controller/safety/melt_interlock.hpp"
#include "protocols/time/instant.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::machine {

/// Where q_f = q_f* - γ k_s (T_s(0) - T_reference) of the output feedback is closed.
enum class GainPlacement : std::uint8_t {
  kBoard,   ///< In the preconditioner, at its own rate.
  kCapped,  ///< In the controller at every SYNC, with the gain limited to what that rate allows.
  kDirect,  ///< In the controller with the full gain: (82) of [K19] as printed, sampled.
};

/// What the loop is told before it runs; [controller.melt] in settings.hpp.
struct MeltSettings {
  std::string law = "output_feedback";
  law::MeltModel model = law::hdpe_melt_model(2e4);
  double T_barrel_degC = 145.0;  ///< Believed while no zone is measured.
  double speed_m_per_s = 0.01;   ///< Nominal; sizes the observer's grid.
  double front_set_m = 0.05;
  law::BacksteppingMeltLaw::Settings backstepping;
  law::PiMeltLaw::Gains pi{.proportional_W_per_m3 = 300.0, .integral_W_per_m3s = 4.5};
  std::size_t observer_cells = 100;
  double start_below_K = 20.0;           ///< First guess of the inlet, below the measured one: Z > 0 wants it colder.
  double max_gain_ramp_m_per_s2 = 0.01;  ///< How fast the speed that the gains belong to follows the measured one.
  safety::MeltLimits limits;
};

/// What the sensors of the front say about themselves at boot.
struct MeltFacts {
  Nanos camera_period{};
  Nanos camera_latency{};
  Nanos inlet_period{};
  Nanos inlet_latency{};
};

/// The camera's newest image at a SYNC.
struct FrontSample {
  Instant sync_at;
  double front_m = 0.0;
  std::optional<Nanos> age;  ///< Of the image at the SYNC; nothing: older than can be told.
  bool good = false;
};

/// The preconditioner's report at a SYNC.
struct InletSample {
  Instant sync_at;
  double T_inlet_degC = 0.0;
  std::optional<Nanos> age;
  bool good = false;
  std::optional<double> mean_flux_W_per_m2;  ///< Applied since the SYNC before, after saturation.
};

/// What is asked of the preconditioner from now on: q_f = feedforward - gain (T_s(0) - T_reference) in the board, or
/// with gain = 0 the flux `feedforward` as it is.
struct MeltRequest {
  double feedforward_W_per_m2 = 0.0;
  double gain_W_per_m2K = 0.0;
  double T_reference_degC = 0.0;
  double Z_W_per_m2 = 0.0;  ///< Of the output feedback; 0 for the other laws.
};

/// Position of the front over time from dated images.
///
/// Between images and over their age it is carried on with the speed of the last images, taken over 1 mm of screw
/// travel: front and screw are of one order of speed, so this is the same share of a transient at every speed.
class FrontTracker {
 public:
  FrontTracker() : images_(kImages) {}
  /// Ignored if it is not newer than the newest.
  void add(Instant taken_at, double front_m, double screw_speed_m_per_s);
  /// Extrapolated, within what the front can do: -3 b ... 0.95 b. @pre !empty().
  [[nodiscard]] double at(Instant at, double screw_speed_m_per_s) const;
  [[nodiscard]] Instant newest_at() const { return images_.back().at; }
  [[nodiscard]] bool empty() const { return images_.empty(); }
  void clear() { images_.clear(); }

 private:
  struct Image {
    Instant at;
    double front_m = 0.0;
  };
  static constexpr std::size_t kImages = 64;
  static constexpr double kSpan_m = 1e-3;
  Ring<Image> images_;
  double span_s_ = 0.0;
};

/// Front tracker, observer and law, put together in the order that they need each other. Per SYNC: note_speed() and
/// add() what has come, then calc() once.
///
/// A sensor that is silent is replaced by the model, never by its last value: the observer carries the front on, and
/// where the board closes the loop its inlet temperature is taken as the closed loop makes it. Gains follow the
/// measured screw speed, not faster than max_gain_ramp; the observer takes the speed as measured. The inlet is never
/// asked to be above the melting point.
/// Real time: no allocation after construction, a few us, most of it the observer's band solve.
class MeltLoop {
 public:
  /// @throws std::invalid_argument if law or observer cannot be made from the settings.
  MeltLoop(const MeltSettings& settings, const MeltFacts& facts, Nanos sync_period);

  void note_speed(double b_m_per_s) { b_m_per_s_ = b_m_per_s; }
  void note_barrel(double T_barrel_degC) { T_barrel_degC_ = T_barrel_degC; }
  /// The coldest that can touch the melt; see safety::MeltObservation. Nothing: the barrel as noted.
  void note_coldest(std::optional<double> T_degC) { T_coldest_degC_ = T_degC; }
  void add(const FrontSample& sample);
  void add(const InletSample& sample);

  /// Front and inlet have been seen, and the screw turns.
  [[nodiscard]] bool is_ready() const;

  /// The request for a SYNC; the first call starts the observer. Nothing if there is no steady state to aim at.
  /// @pre is_ready() at the first call.
  [[nodiscard]] std::optional<MeltRequest> calc(Instant sync_at);
  /// The next calc() starts anew, with a fresh observer.
  void stop();
  void set_front(double front_set_m) { settings_.front_set_m = front_set_m; }

  [[nodiscard]] bool is_running() const { return running_; }
  [[nodiscard]] double front_set_m() const { return settings_.front_set_m; }
  [[nodiscard]] double front_m() const { return front_m_; }            ///< Y1, or the model's.
  [[nodiscard]] double T_inlet_degC() const { return T_inlet_degC_; }  ///< Newest measured one.
  [[nodiscard]] double T_barrel_degC() const { return T_barrel_degC_; }
  [[nodiscard]] double gain_speed_m_per_s() const { return gain_speed_m_per_s_; }
  [[nodiscard]] const MeltRequest& request() const { return request_; }
  [[nodiscard]] double reference_flux_W_per_m2() const { return reference_ ? reference_->inlet_flux_W_per_m2 : 0.0; }
  [[nodiscard]] double trim_K() const { return backstepping_ == nullptr ? 0.0 : backstepping_->trim_K(); }
  /// Points of the profile for a recording, x = i L/(n - 1).
  static constexpr std::size_t kProfilePoints = 41;
  /// The estimate [°C]: granules before the front, the melting point at it and after it. As of the last calc().
  [[nodiscard]] std::span<const double, kProfilePoints> profile_degC() const { return profile_degC_; }
  [[nodiscard]] double T_inlet_estimate_degC() const { return observer_.T_inlet_degC(); }
  /// T_m - max That: margin to (6) of [K19] in the estimate; negative = violated.
  [[nodiscard]] double solid_margin_K() const { return solid_margin_K_; }
  /// Lower bound of the melt - T_m: margin to (7) of [K19]; negative = may be violated.
  [[nodiscard]] double liquid_margin_K() const { return T_liquid_min_degC() - settings_.model.T_melt_degC; }
  [[nodiscard]] safety::MeltObservation observe() const;

 private:
  [[nodiscard]] std::optional<double> take_front(Instant sync_at) const;
  [[nodiscard]] estimator::MeltObserverInput make_input(Instant sync_at);
  void start_observer(Instant sync_at);
  void follow_speed(double dt_s);
  void look_at_estimate();
  [[nodiscard]] double T_liquid_min_degC() const { return T_coldest_degC_.value_or(T_barrel_degC_); }

  MeltSettings settings_;
  MeltFacts facts_;
  Nanos sync_period_;
  GainPlacement placement_;
  std::unique_ptr<law::MeltLaw> law_;
  const law::BacksteppingMeltLaw* backstepping_ = nullptr;  // law_, if it is one.
  estimator::MeltObserver observer_;
  std::optional<law::MeltReference> reference_;

  double b_m_per_s_ = 0.0;
  double T_barrel_degC_;
  std::optional<double> T_coldest_degC_;
  FrontTracker fronts_;
  std::optional<Instant> inlet_at_;
  double T_inlet_degC_ = 0.0;
  std::optional<double> mean_flux_W_per_m2_;  // Of this SYNC.

  bool running_ = false;
  Instant calculated_at_;
  double gain_speed_m_per_s_ = 0.0;
  double front_m_ = 0.0;
  bool inlet_fresh_ = false;
  double front_coasted_m_ = 0.0;
  double inlet_coasted_m_ = 0.0;
  MeltRequest request_;
  std::array<double, kProfilePoints> profile_degC_{};
  double solid_margin_K_ = 0.0;
};

}  // namespace meltbench::machine
