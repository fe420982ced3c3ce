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
#include "plant_emulator/board_gate.hpp"
#include "plant_emulator/plant.hpp"
#include "plant_emulator/plant_settings.hpp"
#include "plant_emulator/process_faults.hpp"
#include "plant_emulator/serial_boards.hpp"
#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::emulator {

/// One board of the rig, on CAN or on a serial line.
struct BoardSettings {
  std::string name;
  std::uint8_t node_id = 0;                                     ///< On CAN.
  std::shared_ptr<const canopen::ObjectDictionary> dictionary;  ///< On CAN: of its EDS, for this node id.
  std::variant<board::FeederSettings, board::ScrewDriveSettings, board::MeltPressureSettings, board::HeaterSettings,
               board::PreconditionerSettings, board::MeltCameraSettings>
      firmware;
  std::string line{};     ///< On a serial line: its name.
  std::uint8_t unit = 0;  ///< And its Modbus address there.
};

struct EmulatorSettings {
  PlantSettings plant;
  std::vector<BoardSettings> boards;             ///< At most one of each kind; those of the rig that are emulated.
  bool knows_truth = true;                       ///< No board of the rig is real: the model is all there is.
  std::vector<MaterialChange> material_changes;  ///< In the order of time.
  std::vector<config::RigLine> lines{};          ///< That have boards on them.
};

/// Reads [plant] (plant_settings.hpp) and the emulator's part of every [board.NAME] (board/settings.hpp); the EDS files
/// are read too.
///
/// @throws config::ConfigError: a value out of range, an EDS that cannot be read or is not one of such a board, two
/// boards of one kind, nothing to emulate.
[[nodiscard]] EmulatorSettings read_settings(const config::Section& root, const config::Rig& rig);

/// Plant and boards on one CAN link and on serial lines, as one participant ("plant").
///
/// It is woken for what can be seen on the bus only. Samples and actuations in between are caught up on: the plant is
/// advanced to each of their instants exactly, feed and screw speed held between. Boards hear each other's frames at
/// the instant of their sending, or from the bus if that tells the states of nodes: it then carries frames between
/// them, and a board that is bus-off hears none. (A board then also gets its own frames back, and has no use for them.)
///
/// Real time: no allocation in the steady state; a SYNC answered by three boards costs about 1 us.
class Emulator final : public Participant {
 public:
  /// @param seed  of the run: phases of the boards' clocks, noise.
  /// @throws std::invalid_argument, std::out_of_range for settings that read_settings() would not have given.
  Emulator(const EmulatorSettings& settings, std::uint64_t seed);
  ~Emulator() override;

  [[nodiscard]] std::string_view name() const override { return "plant"; }
  [[nodiscard]] std::span<const std::string> lines() const override { return serial_.line_names(); }
  /// Its boards on CAN.
  [[nodiscard]] std::span<const std::string> nodes() const override { return nodes_; }
  void wake(const Wakeup& in, Outbox& out) override;

  /// plant.*, melt.*, barrel.*: the model's own truth, which no board shows; not offered beside real boards, of which
  /// the model knows nothing. NAME.*: what the firmware of board NAME knows.
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return signals_; }
  void read_signals(std::span<double> values) const override;

 private:
  void start();
  void obey(const std::string& order);
  void take_arrivals(const Wakeup& in);
  void deliver(const can::CanFrame& frame, std::span<const can::ErrorState> states);
  void send_all(Outbox& out) const;
  void run_timers_before(Instant limit);
  void advance(Instant to);
  void mark_sender(std::size_t board);
  void tell_others();
  [[nodiscard]] Instant next_deadline() const;
  void report_boards(Outbox& out);

  std::unique_ptr<Plant> plant_;
  ProcessFaults process_;    // The plant as the boards see it.
  std::size_t truth_count_;  // Signals of the plant that are offered.
  bool knows_truth_;
  std::vector<std::unique_ptr<board::Board>> boards_;  // On CAN,
  std::vector<std::string> nodes_;                     // their names,
  std::vector<BoardGate> gates_;                       // and what stands before each.
  SerialBoards serial_;
  std::vector<board::Device*> devices_;  // All of them, in the order of the rig.
  std::vector<SignalInfo> signals_;
  std::vector<MaterialChange> material_changes_;
  std::size_t next_change_ = 0;
  bool started_ = false;
  Instant now_{};
  canopen::Frames frames_;            // Sent in this wake-up,
  std::vector<std::size_t> senders_;  // by this board,
  std::size_t told_ = 0;              // and so many of them the other boards have heard.
  bool wire_tells_ = false;           // The bus knows the boards apart: it carries frames between them, too.
};

}  // namespace meltbench::emulator
