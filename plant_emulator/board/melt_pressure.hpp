#pragma once
/// Melt pressure transmitter at the nozzle: CiA 404 analogue input with a time stamp on every sample.

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/board/sampling.hpp"
#include "plant_emulator/board/settings.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::board {

/// Melt pressure transmitter at the nozzle. Objects that a controller needs (fixtures/boards/melt_pressure.eds has
/// all):
/// - 9130:1  I32     TPDO 1  pressure in bar with 5 digits (6131, 6132): one count is 1 Pa
/// - 6150:1  U8      TPDO 1  InputStatus
/// - 2001    U16     TPDO 1  age of the sample at the instant of the SYNC [us]; 0xFFFF: 65.535 ms or older
/// - 6130:1  REAL32  TPDO 2  the same pressure [bar]; TPDO 2 is off until a master enables it
/// - 9130:2  I32     TPDO 3  melt temperature in degC with 1 digit; TPDO 3 is off until a master enables it
/// - 6150:2  U8      TPDO 3  InputStatus of it; kNotValid where the plant has no melt temperature
/// - 6114:1  U32     ro      sample period [us]
/// - 2002    U32     ro      latency [us] from the instant of a sample to when it can be read
/// - 6125:1  U32     wo      0x6F72657A "zero": the pressure of now becomes 0; offset in 6124:1 [bar]
///
/// TPDO 1 is synchronous (type 1) and carries the newest sample available at SYNC: it was taken at t_SYNC - age.
///
/// The transmitter's firmware: sample, filter, quantise, make available one latency later.
///
/// Without filter only samples that can still be read are taken: skipping the others changes nothing that can be seen,
/// because noise belongs to the sample's number and not to the order of drawing. At power-up (and NMT reset node) one
/// sample is taken at once.
class MeltPressure final : public Board {
 public:
  /// Parameters and @throws as Feeder.
  MeltPressure(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
               const MeltPressureSettings& settings, Chance chance, Process& process);

  [[nodiscard]] Instant next_touch(Instant until) const override;
  void touch(Instant at) override;

  [[nodiscard]] std::span<const std::string_view> signal_names() const override;
  void settle(Instant now) override;
  void read_signals(std::span<double> values) const override;

 protected:
  void run_timers(Instant /*now*/) override {}
  void refresh(Instant now) override;

  canopen::AbortCode on_write(Instant now, const canopen::OdEntry& entry, std::span<const std::uint8_t> value) override;
  void on_written(Instant now, const canopen::OdEntry& entry) override;
  void on_reset(Instant now, canopen::ResetKind kind) override;

 private:
  static constexpr std::size_t kMaxFilter = 64;

  struct Sample {
    Instant taken_at;
    double pressure_Pa = 0;  // After the filter.
    double melt_degC = Process::kNothing;
  };

  [[nodiscard]] std::size_t filter_length() const;
  [[nodiscard]] double filter(double pressure_Pa);
  void make_available(Instant now);
  [[nodiscard]] double reading_Pa() const;
  [[nodiscard]] double melt_reading_degC() const;
  [[nodiscard]] std::uint8_t status() const;

  MeltPressureSettings settings_;
  SampleClock clock_;
  std::uint64_t noise_seed_;

  canopen::OdValue<std::int32_t> count_Pa_;
  canopen::OdValue<std::int32_t> count_0p1degC_;
  canopen::OdValue<std::uint8_t> status_, melt_status_, filter_type_, filter_constant_;
  canopen::OdValue<std::uint16_t> age_us_;
  canopen::OdValue<float> field_bar_, pv_bar_, offset_bar_, field_degC_, pv_degC_;

  Instant sampled_at_ = SampleClock::kNone;
  Ring<Sample> pending_;  // Taken, not yet available.
  Sample newest_;
  std::array<double, kMaxFilter> recent_Pa_{};
  std::size_t recent_count_ = 0;  // Samples since power-up.
  double settled_age_s_ = 0;
};

}  // namespace meltbench::board
