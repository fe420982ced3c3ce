#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "protocols/can/frame.hpp"

namespace meltbench::tap {

/// Somebody outside who looks at the embedded bus and may talk on it. No call waits for it.
class Visitor {
 public:
  virtual ~Visitor() = default;

  /// Hands over what waits as far as it is taken, and takes what has been sent.
  /// @param room  how many frames may be taken.  @param sent  they are appended, oldest first.
  virtual void read(std::size_t room, std::vector<can::CanFrame>& sent) = 0;

  /// A frame was on the bus.
  virtual void show(const can::StampedFrame& frame) = 0;

  /// For poll(2): readable when read() is worth a call; -1 while there is nothing to wait for.
  [[nodiscard]] virtual int fd() const = 0;
  [[nodiscard]] virtual bool is_gone() const = 0;
  /// A program that is known to look at the bus.
  [[nodiscard]] virtual bool is_looking_on() const = 0;
  /// Something waits for it that it would not take yet.
  [[nodiscard]] virtual bool has_backlog() const = 0;
  /// Handed over so far, in any unit; grows while it takes something.
  [[nodiscard]] virtual std::uint64_t handed() const = 0;
  /// What it has lost, for people; what waits for it still is lost. Empty: nothing.
  [[nodiscard]] virtual std::string complaint() const = 0;
};

}  // namespace meltbench::tap
