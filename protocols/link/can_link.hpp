#pragma once
/// The seam between a program and a CAN bus: a kernel interface, or the embedded bus at wall-clock pace.

#include <cstdint>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

#include "protocols/can/frame.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::link {

/// kFull: the transmit queue has no room, try again later. kDown: the bus is not there now; it may come back.
/// kUnsupported: this bus cannot carry such a frame (FD on a classic interface).
enum class SendStatus : std::uint8_t { kSent, kFull, kDown, kUnsupported };

/// A frame and the CLOCK_MONOTONIC reading at which it arrived, by the kernel's stamp where there is one.
struct ReceivedFrame {
  Nanos at_monotonic{};
  can::CanFrame frame;
};

/// What a link has seen go wrong. Only ever grows.
struct LinkCounters {
  std::uint64_t full = 0;     ///< Sends refused because the transmit queue was full (ENOBUFS).
  std::uint64_t downs = 0;    ///< Times that the link went down.
  std::uint64_t dropped = 0;  ///< Received frames that the kernel dropped because we read too late (SO_RXQ_OVFL).
  std::uint64_t errors = 0;   ///< Error frames received.
  std::uint64_t refused = 0;  ///< Sent frames that an adapter refused after it had taken them.
};

/// A CAN bus as a program sees it. Never blocks, never throws: the loop reads a status.
class CanLink {
 public:
  virtual ~CanLink() = default;
  [[nodiscard]] virtual SendStatus send(const can::CanFrame& frame) noexcept = 0;
  /// As this one of the sender's nodes, where the link knows them apart.
  [[nodiscard]] virtual SendStatus send_as(std::uint8_t /*node*/, const can::CanFrame& frame) noexcept {
    return send(frame);
  }
  /// The oldest frame waiting; nothing: none waits.
  [[nodiscard]] virtual std::optional<ReceivedFrame> receive() noexcept = 0;
  /// Whether the bus is there. Looks again, and reopens what has gone, when it was not.
  [[nodiscard]] virtual bool is_up() noexcept = 0;
  /// For poll(2): readable when a frame waits. May change after is_up(); -1 while there is nothing to wait for.
  [[nodiscard]] virtual int fd() const noexcept = 0;
  [[nodiscard]] virtual const LinkCounters& counters() const noexcept = 0;
};

/// Set-up failed: what, and what to do about it. Programs print both and exit with status 2.
class LinkError : public std::runtime_error {
 public:
  LinkError(const std::string& what, std::string hint) : std::runtime_error{what}, hint_{std::move(hint)} {}
  [[nodiscard]] const std::string& hint() const { return hint_; }

 private:
  std::string hint_;
};

/// What a bus name says:
///   virtual:NAME            an embedded bus
///   socketcan:can0, can0    a kernel interface
///   slcan:PORT@BIT_RATE     an adapter on a serial port, e.g. slcan:/dev/ttyACM0@500000 (default 500000)
///   none                    no CAN bus
struct BusUri {
  enum class Kind : std::uint8_t { kVirtual, kSocketCan, kSlcan, kNone } kind = Kind::kVirtual;
  std::string name;                            ///< Of bus, interface or port.
  std::uint32_t bit_rate_bit_per_s = 500'000;  ///< slcan only.
};

/// @throws LinkError naming the text if it is no bus name.
[[nodiscard]] BusUri parse_bus_uri(std::string_view text);

/// Opens a bus that this process reaches by itself: any but an embedded one. @pre uri.kind is not kVirtual.
/// @throws LinkError with the reason and what to do.
[[nodiscard]] std::unique_ptr<CanLink> open_can_link(const BusUri& uri);

}  // namespace meltbench::link
