#pragma once
/// What the languages of other people's CAN programs have in common. A dialect is pure: text in, text out.

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/can/frame.hpp"

namespace meltbench::tap {

/// One conversation with one client, in its language. Whoever owns the connection moves the bytes.
class Dialect {
 public:
  virtual ~Dialect() = default;

  /// Appends what the server says first.
  virtual void greet(std::string& answers) const = 0;

  /// Understands what the client has said.
  /// @param said     all that has come and was not yet used up.
  /// @param room     how many frames may be taken. It stops before one more, and the rest is for the next call.
  /// @param answers  what to say to that is appended.
  /// @param sent     the frames that the client puts on the bus are appended.
  /// @returns how many bytes of `said` were used up. It never keeps more than a short piece of an unended message.
  [[nodiscard]] virtual std::size_t hear(std::string_view said, std::size_t room, std::string& answers,
                                         std::vector<can::CanFrame>& sent) = 0;

  /// True once the client has asked to see the bus.
  [[nodiscard]] virtual bool wants_frames() const = 0;

  /// Appends a frame that was on the bus; nothing if this language has no words for it.
  virtual void tell(const can::StampedFrame& frame, std::string& out) = 0;
};

}  // namespace meltbench::tap
