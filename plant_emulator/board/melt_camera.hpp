#pragma once
/// Melt camera: sees through windows in the barrel where the granules end, and how warm they are at the inlet.

#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/board/sampling.hpp"
#include "plant_emulator/board/settings.hpp"
#include "protocols/time/ring.hpp"

namespace meltbench::board {

/// The camera's firmware. Objects that a controller needs (fixtures/boards/melt_camera.eds has all):
/// - 9130:1  I32  TPDO 1     distance of the melting front from the inlet [um]
/// - 9130:2  I32  TPDO 2     surface temperature at the inlet [0.001 degC]
/// - 6150    U8   TPDO 1, 2  InputStatus of either: kNotValid while the newest image is lost, or shows no front
/// - 2003    U8   TPDO 1, 2  number of the newest good image modulo 256
/// - 2001    U16  TPDO 1, 2  its age at the instant of the SYNC [10 us]; 0xFFFF: 0.655 s or older
/// - 2004    U32  ro         images lost since power-up
///
/// Both TPDOs are synchronous (type 1). An image that is lost in a drop-out leaves the values as they were, and their
/// age grows. Which images are lost depends on the seed and the image's number alone.
class MeltCamera final : public Board {
 public:
  /// Parameters and @throws as Feeder.
  MeltCamera(std::string name, const canopen::ObjectDictionary& dictionary, std::uint8_t node_id,
             const MeltCameraSettings& settings, Chance chance, Process& process);

  [[nodiscard]] Instant next_touch(Instant until) const override;
  void touch(Instant at) override;

  [[nodiscard]] std::span<const std::string_view> signal_names() const override;
  void settle(Instant now) override;
  void read_signals(std::span<double> values) const override;

 protected:
  void run_timers(Instant /*now*/) override {}
  void refresh(Instant now) override;
  void on_reset(Instant now, canopen::ResetKind kind) override;

 private:
  struct Image {
    Instant taken_at;
    bool lost = false;
    double front_m = Process::kNothing;
    double T_degC = Process::kNothing;
  };

  [[nodiscard]] bool is_lost(std::int64_t number) const;
  [[nodiscard]] Image take(Instant at);
  void make_available(Instant now);

  MeltCameraSettings settings_;
  SampleClock clock_;
  std::uint64_t front_seed_, temperature_seed_, drop_out_seed_;

  canopen::OdValue<std::int32_t> count_um_, count_mK_;
  canopen::OdValue<std::uint8_t> front_status_, T_status_, number_;
  canopen::OdValue<std::uint16_t> age_;
  canopen::OdValue<std::uint32_t> lost_count_;
  canopen::OdValue<float> front_fv_, T_fv_, front_pv_, T_pv_;

  Instant taken_at_ = SampleClock::kNone;
  Ring<Image> pending_;  // Taken, not yet available.
  Image good_;           // The newest that was not lost.
  bool newest_is_lost_ = false;
  std::uint8_t good_number_ = 0;
  std::uint32_t lost_images_ = 0;
  double settled_age_s_ = 0;
};

}  // namespace meltbench::board
