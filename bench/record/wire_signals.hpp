#pragma once
/// What the boards and their master say to each other, as signals: all that a bench can know of parts that are not its
/// own.

#include <cstdint>
#include <deque>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "protocols/can/frame.hpp"
#include "protocols/canopen/object_dictionary.hpp"
#include "protocols/canopen/pdo.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::record {

/// Follows the objects of a rig's CAN boards on the wire: values in PDOs, by the mapping of the EDS or the one that a
/// master has written since, and values that a master writes by expedited SDO once the board has taken them.
///
/// "wire.feeder.2001" is object 0x2001 of [board.feeder], "wire.heater.7130_2" its sub-index 2. The value is the number
/// on the wire, in the unit and scale that the EDS says; none (NaN) until it was seen, and kept from then on. A board
/// that boots has the mapping of its EDS again.
class WireSignals {
 public:
  /// @param wanted  names to follow beside those that the EDS maps; those that no board has are left out.
  /// @throws config::ConfigError at the board whose EDS cannot be used.
  WireSignals(std::span<const config::RigBoard> boards, std::span<const std::string> wanted);

  [[nodiscard]] const std::vector<SignalInfo>& signals() const { return signals_; }

  /// Takes a frame of the wire. Cost: some 20 ns, no allocation unless it changes a mapping.
  void on_frame(const can::CanFrame& frame);

  /// Values after the frames so far, in the order of signals(). @pre values.size() == signals().size().
  void read(std::span<double> values) const;

 private:
  struct FollowedPdo {
    canopen::PdoDirection direction;
    canopen::Pdo pdo;
    std::vector<std::size_t> columns;  ///< Signals that it carries.
  };
  struct Write {
    canopen::ObjectAddress address;
    std::vector<std::uint8_t> value;
  };
  struct Node {
    std::string name;
    std::uint8_t id = 0;
    canopen::ObjectDictionary dictionary;
    std::vector<FollowedPdo> pdos;
    std::optional<Write> asked;  ///< SDO download that the board has not answered yet.
  };
  struct Column {
    const canopen::OdEntry* entry = nullptr;
    bool seen = false;
  };

  void add_node(const config::RigBoard& board, std::span<const std::string> wanted);
  void add_column(const Node& node, const canopen::OdEntry& entry);
  void note_columns(Node& node, FollowedPdo& followed);
  void take_sdo_request(Node& node, const can::CanFrame& frame) const;
  void take_sdo_answer(Node& node, const can::CanFrame& frame);
  void reset_mapping(Node& node);
  void read_mapping(Node& node, std::uint16_t index);

  std::deque<Node> nodes_;
  std::vector<Column> columns_;
  std::vector<SignalInfo> signals_;
};

}  // namespace meltbench::record
