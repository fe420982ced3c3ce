#pragma once
/// What the boards and their master say to each other, as signals: all that a bench can know of parts that are not its
/// own.

#include <deque>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "bench/decode/board_objects.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::decode {

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

  /// Takes a frame of the wire. Cost: some 20 ns for each value in it, no allocation unless it changes a mapping.
  void on_frame(const can::CanFrame& frame);

  /// Values after the frames so far, in the order of signals(). @pre values.size() == signals().size().
  void read(std::span<double> values) const;

 private:
  void add_columns(const BoardObjects& board, std::span<const std::string> wanted);
  void take_pdo(const FollowedPdo& followed, const can::CanFrame& frame);
  void set(const canopen::OdEntry& entry, std::span<const std::uint8_t> bytes);

  std::deque<BoardObjects> boards_;
  std::unordered_map<const canopen::OdEntry*, std::size_t> columns_;  ///< Of the objects that are followed.
  std::vector<double> values_;
  std::vector<SignalInfo> signals_;
};

}  // namespace meltbench::decode
