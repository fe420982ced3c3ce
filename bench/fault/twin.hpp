#pragma once
/// A second device with the node id of a board.

#include <cstddef>
#include <vector>

#include "protocols/canopen/node.hpp"
#include "protocols/fault/fault.hpp"

namespace meltbench::fault {

/// A device of the same make as a board, just out of the box: dictionary and values are those of its EDS, and it is
/// connected to nothing but the bus. Pure but for its EDS, which the constructor reads.
class Twin {
 public:
  /// @param fault  of the kind same_node_id.
  /// @throws config::ConfigError if the EDS cannot be read.
  explicit Twin(const Fault& fault);

  /// It is plugged in: boots up, or has been running for long and says nothing.
  void plug_in(Instant now, canopen::Frames& out);
  void unplug() { is_in_ = false; }
  [[nodiscard]] bool is_in() const { return is_in_; }

  void on_frame(Instant now, const can::CanFrame& frame, canopen::Frames& out) { node_.on_frame(now, frame, out); }
  void on_time(Instant now, canopen::Frames& out) { node_.on_time(now, out); }
  [[nodiscard]] Instant next_deadline() const { return is_in_ ? node_.next_deadline() : Instant::never(); }

 private:
  bool runs_;
  bool is_in_ = false;
  Nanos heartbeat_;
  canopen::Node node_;
};

}  // namespace meltbench::fault
