#pragma once
/// Understands what goes over a rig's CAN bus: who speaks, what it means, which values it carries.

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/can/frame.hpp"
#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/canopen/pdo.hpp"
#include "protocols/config/rig.hpp"

namespace meltbench::decode {

/// A value in a PDO.
struct DecodedValue {
  canopen::ObjectAddress address;
  std::string_view name;  ///< Of the object, by the EDS.
  double value = 0.0;
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
  /// Boards on serial lines are passed over.
  /// @throws canopen::EdsError, config::ConfigError if an EDS cannot be read.
  explicit BusView(const config::Rig& rig);

  /// Takes note of one frame, in the order of the bus.
  void take(const can::CanFrame& frame);

  [[nodiscard]] FrameMeaning meaning_of(const can::CanFrame& frame) const;
  /// Whether the controller of the rig is who sends such a frame.
  [[nodiscard]] bool is_from_controller(const can::CanFrame& frame) const;
  /// Values of a PDO as it is mapped now; empty for any other frame. Valid until the next call.
  [[nodiscard]] std::span<const DecodedValue> values_of(const can::CanFrame& frame);
  /// One line for people: "feeder TPDO1: Mass flow 1.25, Net weight 12.4", "heater heartbeat: operational".
  [[nodiscard]] std::string describe(const can::CanFrame& frame);

  /// Name of the board with this node id, "controller", or "node 12".
  [[nodiscard]] std::string name_of(std::uint8_t node) const;

 private:
  struct Node {
    std::string name;
    std::uint8_t id = 0;
    canopen::ObjectDictionary dictionary;
    std::vector<canopen::Pdo> tpdos;
    std::vector<canopen::Pdo> rpdos;
    struct Download {
      canopen::ObjectAddress address;
      std::vector<std::uint8_t> value;
    };
    std::optional<Download> asked;  ///< Of a PDO's objects, not answered yet.
  };
  struct PdoPlace {
    Node* node = nullptr;
    canopen::Pdo* pdo = nullptr;
    canopen::PdoDirection direction{};
  };

  [[nodiscard]] const Node* find_node(std::uint8_t id) const;
  [[nodiscard]] Node* find_node(std::uint8_t id);
  [[nodiscard]] const PdoPlace* find_pdo(const can::CanFrame& frame) const;
  void note_download(Node& node, const can::CanFrame& request);
  void confirm_download(Node& node);
  void restore_defaults(Node& node);
  void list_pdos();
  [[nodiscard]] std::string describe_sdo(const FrameMeaning& meaning, const can::CanFrame& frame) const;
  [[nodiscard]] std::string describe_values(const can::CanFrame& frame);

  std::uint8_t controller_id_;
  std::vector<std::unique_ptr<Node>> nodes_;
  std::array<PdoPlace, can::kMaxStandardId + 1> pdos_{};
  std::vector<DecodedValue> values_;
};

}  // namespace meltbench::decode
