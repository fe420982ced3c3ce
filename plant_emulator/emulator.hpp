#pragma once
/// The extruder as it stands in the field: the model, and on the bus the boards that measure and drive it.

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "plant_emulator/board/board.hpp"
#include "plant_emulator/board/settings.hpp"
#include "plant_emulator/model/bizone_extruder.hpp"
#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::emulator {

/// One board of the rig.
struct BoardSettings {
  std::string name;
  std::uint8_t node_id = 0;
  std::shared_ptr<const canopen::ObjectDictionary> dictionary;  ///< Of its EDS, for this node id.
  std::variant<board::FeederSettings, board::ScrewDriveSettings, board::MeltPressureSettings> firmware;
};

struct EmulatorSettings {
  plant::BizoneParameters plant;
  std::vector<BoardSettings> boards;  ///< At most one of each kind.
};

/// Reads [plant] and the emulator's part of every [board.NAME]; the EDS files are read too.
///
/// [plant], key, range, (default), what:
/// - preset            paper | slow | phys | rad (slow)   how the published speed is read, see MODEL.md
/// - fluctuation_case  none | A | B (A)                   the two published fluctuations of the conveying speed
/// - fluctuation_on    screw | slip (screw)               whether the encoder on the screw sees it
/// - delay_model       transport | paper (the preset's)   true travel time, or the delay as printed
/// - x0_m              0..length (0.1)                    filled length at the start
/// - nominal_x_m       > 0, < length (0.16)               filled length that the feeder's loss-of-master flow leads to
/// - U_before_start    0..0.999 (v(x0))                   filling ratio of what is under way at the start
/// - epsilon           >= 0, < 1 (the case's)             share of the speed that fluctuates
/// - omega_rad_per_s   >= 0 (the case's)                  how fast
/// - phase_rad         any (0)                            phase of the fluctuation at the start
/// - speed_m_per_s     > 0 (the preset's)                 nominal conveying speed
/// - length_m, pitch_m, density_kg_per_m3, pressure_flow_m4, nozzle_kg, area_m2, viscosity_Pa_s
///                     > 0 (model/bizone_parameters.hpp)  geometry and melt
/// The keys of the boards are listed in board/settings.hpp.
///
/// @throws config::ConfigError: a value out of range, an EDS that cannot be read or is not one of such a board, two
/// boards of one kind.
[[nodiscard]] EmulatorSettings read_settings(const config::Section& root, const config::Rig& rig);

/// Plant and boards on one CAN link, as one participant ("plant").
///
/// It is woken for what can be seen on the bus only. Samples and actuations in between are caught up on: the plant is
/// advanced to each of their instants exactly, feed and screw speed held between. Boards hear each other's frames at
/// the instant of their sending.
///
/// Real time: no allocation in the steady state; a SYNC answered by three boards costs about 1 us.
class Emulator final : public Participant {
 public:
  /// @param seed  of the run: phases of the boards' clocks, noise.
  /// @throws std::invalid_argument, std::out_of_range for settings that read_settings() would not have given.
  Emulator(const EmulatorSettings& settings, std::uint64_t seed);
  ~Emulator() override;

  [[nodiscard]] std::string_view name() const override { return "plant"; }
  void wake(const Wakeup& in, Outbox& out) override;

  /// plant.*: the model's own truth, which no board shows. NAME.*: what the firmware of board NAME knows.
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override;

  [[nodiscard]] const plant::BizoneExtruder& extruder() const;

 private:
  class ExtruderProcess;

  void start();
  void deliver(const can::CanFrame& frame);
  void run_timers_before(Instant limit);
  void advance(Instant to);
  void mark_sender(std::size_t board);
  void tell_others();
  [[nodiscard]] Instant next_deadline() const;
  void report_plant(Outbox& out);

  std::unique_ptr<ExtruderProcess> process_;
  std::vector<std::unique_ptr<board::Board>> boards_;
  std::vector<SignalInfo> signals_;
  bool started_ = false;
  bool was_flooded_ = false;
  Instant now_{};
  canopen::Frames frames_;            // Sent in this wake-up,
  std::vector<std::size_t> senders_;  // by this board,
  std::size_t told_ = 0;              // and so many of them the other boards have heard.
};

}  // namespace meltbench::emulator
