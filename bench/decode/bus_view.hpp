#pragma once
/// Understands what goes over a rig's CAN bus: who speaks, what it means, which values it carries.

#include <array>
#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "bench/decode/board_objects.hpp"
#include "bench/decode/dbc.hpp"

namespace meltbench::decode {

/// A value in a PDO.
struct DecodedValue {
  canopen::ObjectAddress address;
  std::string_view name;  ///< Of the object, by the EDS.
  double value = 0.0;
  canopen::DataType type = canopen::DataType::kUnsigned8;  ///< On the wire.
};

/// What a frame of CANopen is for.
enum class Service : std::uint8_t { kNmt, kSync, kEmcy, kTpdo, kRpdo, kSdoResponse, kSdoRequest, kHeartbeat, kOther };

/// What is known of a frame without its content.
struct FrameMeaning {
  Service service = Service::kOther;
  std::uint8_t node = 0;    ///< Board that it is of or for; 0: none of the rig's.
  std::uint8_t number = 0;  ///< Of a PDO, from 1.
  bool is_cyclic = false;   ///< A TPDO that is due with every n-th SYNC, or after its event time at the latest.
};

/// A listener on the bus of a rig. It knows the boards by their EDS files, and follows what the master changes in their
/// PDOs, so that values come out as they are mapped at that time.
class BusView {
 public:
  /// Boards on serial lines are passed over. A rig without any board is one of which nothing is known: no frame is
  /// taken for CANopen then.
  /// @param dbc  names the frames that nobody of the rig uses; must live as long as this. May be null.
  /// @throws config::ConfigError at the board whose EDS cannot be used.
  explicit BusView(const config::Rig& rig, const Dbc* dbc = nullptr);

  /// Takes note of one frame, in the order of the bus.
  void take(const can::CanFrame& frame);

  [[nodiscard]] FrameMeaning meaning_of(const can::CanFrame& frame) const;
  /// The DBC's message; nullptr for a frame of the rig, and for one that the DBC does not know.
  [[nodiscard]] const DbcMessage* find_message(const can::CanFrame& frame) const;
  /// Whether the controller of the rig is who sends such a frame.
  [[nodiscard]] bool is_from_controller(const can::CanFrame& frame) const;
  /// Values of a PDO as it is mapped now; empty for any other frame. Valid until the next call.
  [[nodiscard]] std::span<const DecodedValue> values_of(const can::CanFrame& frame);
  /// One line for people: "feeder TPDO1: Mass flow 1.25, Net weight 12.4", "heater heartbeat: operational".
  [[nodiscard]] std::string describe(const can::CanFrame& frame);

  /// Name of the board with this node id, "controller", or "node 12".
  [[nodiscard]] std::string name_of(std::uint8_t node) const;

 private:
  struct PdoPlace {
    const BoardObjects* board = nullptr;
    const FollowedPdo* followed = nullptr;
  };

  [[nodiscard]] const BoardObjects* find_board(std::uint8_t node) const;
  [[nodiscard]] const PdoPlace* find_pdo(const can::CanFrame& frame) const;
  void list_pdos();
  [[nodiscard]] std::string describe_sdo(const FrameMeaning& meaning, const can::CanFrame& frame) const;
  [[nodiscard]] std::string describe_expedited(std::uint8_t node, const can::CanFrame& frame) const;
  [[nodiscard]] std::string describe_values(const can::CanFrame& frame);

  const Dbc* dbc_;
  bool has_rig_;
  std::uint8_t controller_id_;
  std::deque<BoardObjects> boards_;
  std::array<PdoPlace, can::kMaxStandardId + 1> pdos_{};
  std::vector<DecodedValue> values_;
};

}  // namespace meltbench::decode
