#include "plant_emulator/board/settings.hpp"

namespace meltbench::board {

namespace {

using config::above;
using config::above_up_to;
using config::at_least;
using config::between;

/// A time of the firmware: the wire counts ages and cycles in microseconds.
Nanos read_firmware_time(const config::Section& section, std::string_view key, double fallback_ms, double min_ms,
                         double max_ms) {
  const Nanos time = section.duration_or(key, fallback_ms, between(min_ms, max_ms));
  if (time % 1us != 0ns) section.fail(key, "must be a whole number of microseconds", "e.g. 1.25 or 0.1");
  return time;
}

}  // namespace

FeederSettings read_feeder_settings(const config::Section& section, const PlantRates& plant) {
  FeederSettings settings;
  settings.sample_time = read_firmware_time(section, "sample_time_ms", 1, 0, 100);
  settings.latency = read_firmware_time(section, "latency_ms", 2, 0, 1000);
  settings.flow_resolution_kg_per_h = section.number_or("flow_resolution_kg_per_h", 0, at_least(0));
  settings.max_flow_kg_per_h =
      section.number_or("max_flow_kg_per_h", 1.5 * plant.throat_flow_kg_per_h, above_up_to(0, 100'000));
  settings.watchdog_ms = static_cast<std::uint16_t>(
      section.integer_or("watchdog_ms", 50, between(0, 65535, "a few SYNC periods; 0 = no watchdog")));
  settings.loss_of_master_kg_per_h = section.number_or(
      "loss_of_master_kg_per_h", plant.hold_flow_kg_per_h,
      between(0, settings.max_flow_kg_per_h, "the flow that the machine can live with when nobody controls it"));
  settings.start_flow_kg_per_h =
      section.number_or("start_flow_kg_per_h", plant.start_flow_kg_per_h, between(0, settings.max_flow_kg_per_h));
  settings.hopper_kg = section.number_or("hopper_kg", 25, between(0, 200'000));
  settings.weight_sample_time = read_firmware_time(section, "weight_sample_time_ms", 20, 0.01, 10'000);
  settings.weight_resolution_kg = section.number_or("weight_resolution_kg", 1e-4, at_least(0));
  settings.weight_noise_kg = section.number_or("weight_noise_kg", 0, at_least(0));
  settings.flow_filter_s = section.number_or("flow_filter_s", 1, above_up_to(0, 1000));
  settings.refill_low_kg = section.number_or("refill_low_kg", 0, between(0, settings.hopper_kg));
  settings.refill_high_kg =
      section.number_or("refill_high_kg", settings.hopper_kg, above_up_to(settings.refill_low_kg, 200'000));
  settings.refill_kg_per_h = section.number_or(
      "refill_kg_per_h", std::max(360.0, 2 * settings.max_flow_kg_per_h),
      above_up_to(settings.max_flow_kg_per_h, 1e6, "else the hopper runs empty while it is refilled"));
  settings.refill_settle = section.duration_or("refill_settle_s", to_s(settings.refill_settle), between(0, 600));
  settings.fill_effect = section.number_or("fill_effect", 0, between(-0.5, 0.5));
  return settings;
}

void read_serial_settings(const config::Section& section, FeederSettings& settings) {
  settings.low_word_first = section.choice_or("word_order", "high_first", {"high_first", "low_first"}) == "low_first";
  settings.answer_delay = section.duration_or("answer_delay_ms", 2, between(0, 1000));
}

void read_serial_settings(const config::Section& section, HeaterSettings& settings) {
  settings.answer_delay = section.duration_or("answer_delay_ms", 2, between(0, 1000));
}

ScrewDriveSettings read_screw_drive_settings(const config::Section& section, const PlantRates& plant) {
  ScrewDriveSettings settings;
  settings.sample_time = read_firmware_time(section, "sample_time_ms", 1, 0.01, 100);
  settings.increments_per_rev =
      static_cast<std::uint32_t>(section.integer_or("increments_per_rev", 65536, between(1, 1 << 24)));
  settings.warm_start = section.boolean_or("warm_start", !plant.starts_cold);
  settings.nominal_rev_per_s = plant.screw_rev_per_s;
  settings.ramp_rpm_per_s = section.number_or("ramp_rpm_per_s", 100, between(0, 1e6, "0 = jump"));
  settings.quick_stop_rpm_per_s = section.number_or("quick_stop_rpm_per_s", 500, between(0, 1e6, "0 = jump"));
  return settings;
}

MeltPressureSettings read_melt_pressure_settings(const config::Section& section) {
  MeltPressureSettings settings;
  settings.sample_time = read_firmware_time(section, "sample_time_ms", 2, 0.01, 1000);
  settings.latency = read_firmware_time(section, "latency_ms", 1, 0, 1000);
  settings.resolution_Pa = section.number_or("resolution_Pa", 1, at_least(1, "the wire carries whole pascals"));
  settings.noise_Pa = section.number_or("noise_Pa", 0, at_least(0));
  settings.filter_samples = static_cast<int>(section.integer_or("filter_samples", 1, between(1, 64)));
  settings.span_start_bar = section.number_or("span_start_bar", 0, between(-1000, 10'000));
  settings.span_end_bar = section.number_or("span_end_bar", 50, above_up_to(settings.span_start_bar, 10'000));
  return settings;
}

PreconditionerSettings read_preconditioner_settings(const config::Section& section, const PlantRates& plant) {
  PreconditionerSettings settings;
  settings.sample_time = read_firmware_time(section, "sample_time_ms", 5, 0.01, 1000);
  settings.latency = read_firmware_time(section, "latency_ms", 1, 0, 1000);
  settings.resolution_K = section.number_or("resolution_K", 0.1, at_least(0));
  settings.noise_K = section.number_or("noise_K", 0, at_least(0));
  settings.bias_K = section.number_or("bias_K", 0, between(-100, 100));
  settings.min_flux_W_per_m2 = section.number_or("min_flux_W_per_m2", -5000, between(-1e9, 0, "it cools"));
  settings.max_flux_W_per_m2 = section.number_or("max_flux_W_per_m2", 5000, between(0, 1e9, "it heats"));
  settings.start_flux_W_per_m2 = section.number_or("start_flux_W_per_m2", plant.start_flux_W_per_m2,
                                                   between(settings.min_flux_W_per_m2, settings.max_flux_W_per_m2));
  settings.watchdog_ms = static_cast<std::uint16_t>(
      section.integer_or("watchdog_ms", 50, between(0, 65535, "a few SYNC periods; 0 = no watchdog")));
  return settings;
}

HeaterSettings read_heater_settings(const config::Section& section, const PlantRates& plant) {
  HeaterSettings settings;
  settings.barrel_zones = plant.barrel_zones;
  settings.start = plant.zones;
  settings.sample_time = read_firmware_time(section, "sample_time_ms", 100, 10, 10'000);
  settings.proportional = section.choice_or("output", "relay", {"relay", "proportional"}) == "proportional";
  settings.cycle_s = section.number_or("cycle_s", settings.cycle_s, between(0.1, 600));
  settings.band_K = section.number_or("band_K", settings.band_K, between(0.1, 2000));
  settings.integral_s = section.number_or("integral_s", settings.integral_s, between(0, 3276));
  settings.derivative_s = section.number_or("derivative_s", settings.derivative_s, between(0, 3276));
  settings.resolution_K = section.number_or("resolution_K", settings.resolution_K, at_least(0));
  settings.noise_K = section.number_or("noise_K", 0, at_least(0));
  settings.max_degC = section.number_or("max_degC", settings.max_degC, between(0, 600));
  settings.warm_band_K = section.number_or("warm_band_K", settings.warm_band_K, between(0.1, 100));
  settings.supervision_s = section.number_or("supervision_s", settings.supervision_s, between(1, 3600));
  settings.supervision_K = section.number_or("supervision_K", settings.supervision_K, between(0.1, 100));
  settings.autotune_hysteresis_K =
      section.number_or("autotune_hysteresis_K", settings.autotune_hysteresis_K, between(0.05, 20));
  settings.watchdog_ms = static_cast<std::uint16_t>(
      section.integer_or("watchdog_ms", 1000, between(0, 65535, "a second is nothing to a barrel; 0 = no watchdog")));
  settings.warm_start = section.boolean_or("warm_start", !plant.starts_cold);
  return settings;
}

MeltCameraSettings read_melt_camera_settings(const config::Section& section) {
  MeltCameraSettings settings;
  settings.sample_time = read_firmware_time(section, "sample_time_ms", 20, 0.1, 10'000);
  settings.latency = read_firmware_time(section, "latency_ms", 10, 0, 1000);
  settings.front_resolution_m = section.number_or("front_resolution_m", 1e-5, at_least(0));
  settings.front_noise_m = section.number_or("front_noise_m", 0, at_least(0));
  settings.resolution_K = section.number_or("resolution_K", 0.1, at_least(0));
  settings.noise_K = section.number_or("noise_K", 0, at_least(0));
  settings.drop_out_probability = section.number_or("drop_out_probability", 0, between(0, 1));
  settings.drop_out_images = static_cast<int>(section.integer_or("drop_out_images", 1, between(1, 1000)));
  return settings;
}

}  // namespace meltbench::board
