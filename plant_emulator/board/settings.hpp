#pragma once
/// What a rig says about the boards: the keys of [board.NAME], read strictly into plain structs.
///
/// Times of the firmware are whole microseconds. "Sample time" is the cycle of the board's own clock, which does not
/// know of the bus: its phase is drawn from the run's seed (sampling.hpp), so that no control law can lean on a lucky
/// phase.

#include <array>
#include <cstddef>
#include <cstdint>

#include "protocols/config/section.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::board {

/// Rates of the plant that defaults of the boards are derived from.
struct PlantRates {
  double start_flow_kg_per_h = 0;   ///< Keeps the filled length where the run starts, at nominal speed.
  double hold_flow_kg_per_h = 0;    ///< Open-loop rate v(x*): leads to the nominal filled length and stays there.
  double throat_flow_kg_per_h = 0;  ///< More does not fit into the screw at nominal speed (U = 1).
  double screw_rev_per_s = 0;       ///< Nominal screw speed.
  double start_flux_W_per_m2 = 0;   ///< At the inlet: keeps the melting front where the run starts.
  std::size_t barrel_zones = 0;     ///< Heated zones of the barrel, 0..4. With any there is a heated nozzle as well.
  bool starts_cold = false;         ///< Nothing is heated and nothing turns at the start.
  /// What keeps zones and nozzle where the run starts, by channel of the heater.
  struct Zone {
    double T_degC = 0;
    double heater_share = 0;
  };
  std::array<Zone, 5> zones{};
};

/// [board.NAME] with kind = "feeder". Key, range, (default), what:
/// - sample_time_ms            0..100 (1)             control cycle, takes over set points; 0 = at once
/// - latency_ms                0..1000 (2)            from the control cycle to the changed flow
/// - flow_resolution_kg_per_h  >= 0 (0)               delivered flow is a multiple of it; 0 = as fine as REAL32
/// - max_flow_kg_per_h         > 0 (1.5 x throat)     larger set points are cut to it; object 2009
/// - watchdog_ms               0..65535 (50)          no set point for so long = loss of master, 0 = off; object 2006
/// - loss_of_master_kg_per_h   0..max (v(x*))         flow after loss of master; object 2005
/// - start_flow_kg_per_h       0..max (v(x0))         flow from power-up to the first set point: plant in balance
/// - hopper_kg                 >= 0 (25)              weight in the hopper at the start
/// - weight_sample_time_ms     0.01..10000 (20)       cycle of the scale
/// - weight_resolution_kg      >= 0 (0.0001)          one step of the scale; 0 = as fine as REAL32
/// - weight_noise_kg           >= 0 (0)               standard deviation of the scale's noise
/// - flow_filter_s             > 0, <= 1000 (1)       time constant of the mass flow in 6130:2
/// - refill_low_kg             0..hopper (0)          the refill valve opens at it; 0 = is never refilled
/// - refill_high_kg            > low (hopper_kg)      and closes at it
/// - refill_kg_per_h           > max_flow (360)       through the open valve
/// - refill_settle_s           0..600 (2)             the scale needs it after a refill: volumetric until then
/// - fill_effect               -0.5..0.5 (0)          so much more a hopper at the high limit delivers at equal drive
/// and on a serial line (fixtures/boards/MODBUS.md):
/// - word_order                high_first | low_first (high_first)   of 32-bit values at power-up; register 10
/// - answer_delay_ms           0..1000 (2)            from the end of a request to its answer, at least 3.5 characters
struct FeederSettings {
  Nanos sample_time = 1ms;
  Nanos latency = 2ms;
  double flow_resolution_kg_per_h = 0;
  double max_flow_kg_per_h = 0;
  std::uint16_t watchdog_ms = 50;
  double loss_of_master_kg_per_h = 0;
  double start_flow_kg_per_h = 0;
  double hopper_kg = 25;
  Nanos weight_sample_time = 20ms;
  double weight_resolution_kg = 1e-4;
  double weight_noise_kg = 0;
  double flow_filter_s = 1;
  double refill_low_kg = 0;
  double refill_high_kg = 25;
  double refill_kg_per_h = 360;
  Nanos refill_settle = 2s;
  double fill_effect = 0;
  bool low_word_first = false;
  Nanos answer_delay = 2ms;
};

/// [board.NAME] with kind = "screw_drive". Key, range, (default), what:
/// - sample_time_ms        0.01..100 (1)     cycle of the speed ramp
/// - increments_per_rev    1..2^24 (65536)   encoder increments per screw turn; object 608F
/// - warm_start            (unless cold)     powers up in Operation enabled and turns at nominal speed: the run starts
///                                           in the middle of production, as the published simulations do
/// - ramp_rpm_per_s        >= 0 (100)        acceleration and deceleration at power-up; 0 = jump; objects 6048, 6049
/// - quick_stop_rpm_per_s  >= 0 (500)        deceleration of quick stop and fault reaction; objects 604A, 6085
struct ScrewDriveSettings {
  Nanos sample_time = 1ms;
  std::uint32_t increments_per_rev = 65536;
  bool warm_start = true;
  double nominal_rev_per_s = 0;  ///< From the plant; no key.
  double ramp_rpm_per_s = 100;
  double quick_stop_rpm_per_s = 500;
};

/// [board.NAME] with kind = "melt_pressure". Key, range, (default), what:
/// - sample_time_ms   0.01..1000 (2)     cycle of the converter
/// - latency_ms       0..1000 (1)        from the instant of the sample to when it can be read
/// - resolution_Pa    >= 1 (1)           the value is a multiple of it; the wire carries whole pascals
/// - noise_Pa         >= 0 (0)           standard deviation of the sensor's noise
/// - filter_samples   1..64 (1)          moving average over so many samples, 1 = none; objects 61A0, 61A1
/// - span_start_bar   any (0)            below: cut, and status bit 2; object 6148
/// - span_end_bar     > start (50)       above: cut, and status bit 1; object 6149
struct MeltPressureSettings {
  Nanos sample_time = 2ms;
  Nanos latency = 1ms;
  double resolution_Pa = 1;
  double noise_Pa = 0;
  int filter_samples = 1;
  double span_start_bar = 0;
  double span_end_bar = 50;
};

/// [board.NAME] with kind = "preconditioner". Key, range, (default), what:
/// - sample_time_ms        0.01..1000 (5)       control cycle: takes over set points, samples the temperature
/// - latency_ms            0..1000 (1)          from the instant of the sample to when it can be read
/// - resolution_K          >= 0 (0.1)           the temperature is a multiple of it; 0 = as fine as REAL32
/// - noise_K               >= 0 (0)             standard deviation of the sensor's noise
/// - bias_K                any (0)              error of the sensor, of the reading and in the inner loop
/// - min_flux_W_per_m2     <= 0 (-5000)         the flux is cut to it; object 2004
/// - max_flux_W_per_m2     >= 0 (5000)          the same; object 2005
/// - start_flux_W_per_m2   min..max (the plant's) from power-up to the first order: plant in balance, if it starts so
/// - watchdog_ms           0..65535 (50)        no set point for so long = loss of master, 0 = off; object 2006
struct PreconditionerSettings {
  Nanos sample_time = 5ms;
  Nanos latency = 1ms;
  double resolution_K = 0.1;
  double noise_K = 0;
  double bias_K = 0;
  double min_flux_W_per_m2 = -5000;
  double max_flux_W_per_m2 = 5000;
  double start_flux_W_per_m2 = 0;
  std::uint16_t watchdog_ms = 50;
};

/// [board.NAME] with kind = "melt_camera". Key, range, (default), what:
/// - sample_time_ms        0.1..10000 (20)      from image to image
/// - latency_ms            0..1000 (10)         from the exposure to when the result can be read
/// - front_resolution_m    >= 0 (1e-5)          the front is a multiple of it; the wire carries whole micrometres
/// - front_noise_m         >= 0 (0)             standard deviation of the front's noise
/// - resolution_K          >= 0 (0.1)           the temperature is a multiple of it; the wire carries millikelvins
/// - noise_K               >= 0 (0)             standard deviation of the temperature's noise
/// - drop_out_probability  0..1 (0)             how likely a drop-out begins with an image
/// - drop_out_images       1..1000 (1)          images lost in a drop-out
struct MeltCameraSettings {
  Nanos sample_time = 20ms;
  Nanos latency = 10ms;
  double front_resolution_m = 1e-5;
  double front_noise_m = 0;
  double resolution_K = 0.1;
  double noise_K = 0;
  double drop_out_probability = 0;
  int drop_out_images = 1;
};

/// [board.NAME] with kind = "heater". Key, range, (default), what:
/// - sample_time_ms        10..10000 (100)      cycle of the controllers
/// - output                relay | proportional (relay)   power on for a share of every cycle, or in proportion
/// - cycle_s               0.1..600 (2)         that cycle; objects 7456
/// - band_K                0.1..2000 (20)       proportional band; objects 7450
/// - integral_s            0..3276 (120)        integral time, 0 = none; objects 7452
/// - derivative_s          0..3276 (20)         derivative time; objects 7454
/// - resolution_K          >= 0 (0.02)          step of the converter; the wire carries 0.1 K
/// - noise_K               >= 0 (0)             standard deviation of the thermocouples
/// - max_degC              0..600 (300)         alarm above; objects 2100
/// - warm_band_K           0.1..100 (3)         within it of the set point: bit 1 of the zone state; objects 2101
/// - supervision_s         1..3600 (120)        full power for so long must warm, no power must not; objects 2103
/// - supervision_K         0.1..100 (2)         by so much; objects 2104
/// - autotune_hysteresis_K 0.05..20 (0.3)       of the relay that tries the zone out
/// - watchdog_ms           0..65535 (1000)      no set points for so long: all off, 0 = off; object 2006
/// - warm_start            (unless cold)        powers up in control of zones that are warm already
/// and on a serial line: answer_delay_ms as the feeder's.
struct HeaterSettings {
  std::size_t barrel_zones = 4;  ///< From the plant; no key.
  Nanos sample_time = 100ms;
  bool proportional = false;
  double cycle_s = 2;
  double band_K = 20;
  double integral_s = 120;
  double derivative_s = 20;
  double resolution_K = 0.02;
  double noise_K = 0;
  double max_degC = 300;
  double warm_band_K = 3;
  double supervision_s = 120;
  double supervision_K = 2;
  double autotune_hysteresis_K = 0.3;
  std::uint16_t watchdog_ms = 1000;
  bool warm_start = false;
  std::array<PlantRates::Zone, 5> start{};  ///< From the plant; no key.
  Nanos answer_delay = 2ms;
};

/// Read the board's own keys; the section's finish() is the caller's.
/// @throws config::ConfigError for a value out of range, or a time that is not a whole number of microseconds.
[[nodiscard]] FeederSettings read_feeder_settings(const config::Section& section, const PlantRates& plant);
/// What boards on a serial line have besides.
void read_serial_settings(const config::Section& section, FeederSettings& settings);
void read_serial_settings(const config::Section& section, HeaterSettings& settings);
[[nodiscard]] ScrewDriveSettings read_screw_drive_settings(const config::Section& section, const PlantRates& plant);
[[nodiscard]] MeltPressureSettings read_melt_pressure_settings(const config::Section& section);
[[nodiscard]] PreconditionerSettings read_preconditioner_settings(const config::Section& section,
                                                                  const PlantRates& plant);
[[nodiscard]] HeaterSettings read_heater_settings(const config::Section& section, const PlantRates& plant);
[[nodiscard]] MeltCameraSettings read_melt_camera_settings(const config::Section& section);

}  // namespace meltbench::board
