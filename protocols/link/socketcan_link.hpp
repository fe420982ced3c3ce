#pragma once

#include <linux/can.h>

#include "protocols/link/can_link.hpp"
#include "protocols/link/unique_fd.hpp"

namespace meltbench::link {

/// A kernel CAN interface through a raw socket: classic and FD frames, error frames of every class, the kernel's
/// receive time stamps, and what others on this machine send to the same interface.
///
/// The interface may go down and up, or vanish and come back (a USB adapter unplugged): meanwhile send() says kDown,
/// and is_up() looks for it again by name. A full transmit queue (ENOBUFS) is kFull: the caller waits and tries again.
class SocketCanLink final : public CanLink {
 public:
  /// @param interface_name  e.g. "can0".
  /// @throws LinkError with the reason and what to do: no CAN in the kernel, no such interface, not up, no permission.
  explicit SocketCanLink(std::string interface_name);

  /// Takes a socket that is open already and speaks struct can_frame / canfd_frame, one per datagram.
  SocketCanLink(UniqueFd socket, std::string interface_name, bool fd_frames);

  [[nodiscard]] SendStatus send(const can::CanFrame& frame) noexcept override;
  [[nodiscard]] std::optional<ReceivedFrame> receive() noexcept override;
  [[nodiscard]] bool is_up() noexcept override;
  [[nodiscard]] int fd() const noexcept override { return socket_.get(); }
  [[nodiscard]] const LinkCounters& counters() const noexcept override { return counters_; }

 private:
  void went_down(int error) noexcept;

  std::string interface_name_;
  UniqueFd socket_;
  bool fd_frames_ = false;  ///< The interface takes FD frames (its MTU is 72).
  bool up_ = true;
  LinkCounters counters_;
};

/// True if this kernel knows CAN sockets at all.
[[nodiscard]] bool kernel_has_can() noexcept;

/// struct can_frame or canfd_frame <-> CanFrame. @returns the size to write: CAN_MTU or CANFD_MTU.
[[nodiscard]] std::size_t to_kernel_frame(const can::CanFrame& frame, canfd_frame& kernel) noexcept;
/// @param size  bytes read. @returns nothing if that is no frame.
[[nodiscard]] std::optional<can::CanFrame> from_kernel_frame(const canfd_frame& kernel, std::size_t size) noexcept;

}  // namespace meltbench::link
