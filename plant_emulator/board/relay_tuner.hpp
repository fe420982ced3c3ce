#pragma once
/// Tries out a heated zone with a relay, to find where it would oscillate by itself.

namespace meltbench::board {

/// Relay experiment for a temperature controller: the output switches between two levels whenever the temperature
/// leaves a hysteresis around the set point. The limit cycle that follows has nearly the ultimate period, and
///
///   Ku = 4 d / (pi sqrt(a^2 - h^2))
///
/// d half the distance of the levels, a amplitude, h hysteresis (Åström & Hägglund 1984; describing function of a relay
/// with hysteresis). First the levels are 0 and 1; once the mean output is known they are centred on it, because the
/// describing function is that of a symmetric relay. Tuning from it: Tyreus & Luyben 1992 (no overshoot wanted):
///
///   gain = 0.45 Ku,  Tn = 2.2 Pu,  Tv = Pu/6.3
class RelayTuner {
 public:
  enum class State : unsigned char { kIdle = 0, kRunning = 1, kDone = 2, kFailed = 3 };

  struct Result {
    double ultimate_gain_1_per_K = 0;  ///< Ku, output as a share of full power.
    double ultimate_period_s = 0;      ///< Pu.
    double mean_output = 0;            ///< Over the last cycle: what holds the zone at its set point.
    [[nodiscard]] double proportional_band_K() const { return 1.0 / (0.45 * ultimate_gain_1_per_K); }
    [[nodiscard]] double integral_s() const { return 2.2 * ultimate_period_s; }
    [[nodiscard]] double derivative_s() const { return ultimate_period_s / 6.3; }
  };

  void start(double t_s, double set_degC, double hysteresis_K);
  void stop() { state_ = State::kIdle; }

  /// One sample while running. @returns the output, a share of full power.
  double step(double t_s, double T_degC);

  [[nodiscard]] State state() const { return state_; }
  [[nodiscard]] const Result& result() const { return result_; }  ///< Of the last that was done.

  static constexpr int kFirstCycles = 2;    ///< With the levels 0 and 1.
  static constexpr int kLeastCycles = 3;    ///< With centred levels.
  static constexpr int kMostCycles = 12;    ///< If period and amplitude have not settled by then, it has failed.
  static constexpr double kSettled = 0.03;  ///< Period from cycle to cycle.
  static constexpr double kTimeOut_s = 7200;

 private:
  void begin_cycle(double t_s, double T_degC);
  void end_cycle(double t_s);
  void centre(double mean_output);

  State state_ = State::kIdle;
  Result result_;
  double set_degC_ = 0, hysteresis_K_ = 0;
  double started_s_ = 0, last_s_ = 0;
  double high_ = 1, low_ = 0;
  bool is_high_ = true;
  bool in_cycle_ = false;  // From the first switching on.
  int cycles_ = 0;
  double cycle_began_s_ = 0, output_sum_s_ = 0, max_degC_ = 0, min_degC_ = 0;
  double period_before_s_ = 0;
};

}  // namespace meltbench::board
