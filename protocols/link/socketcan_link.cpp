#include "protocols/link/socketcan_link.hpp"

#include <fmt/format.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

#include "protocols/link/clock.hpp"

namespace meltbench::link {
namespace {

constexpr int kReceiveBytes = 4 << 20;  // Some 5000 frames: seconds of a full bus.

/// Kernel stamps are on CLOCK_REALTIME; the bench counts on CLOCK_MONOTONIC.
Nanos to_monotonic(const timespec& stamp) noexcept {
  const Nanos realtime{stamp.tv_sec * 1'000'000'000LL + stamp.tv_nsec};
  return realtime - (read_clock(CLOCK_REALTIME) - read_monotonic());
}

ifreq make_request(const std::string& interface_name) noexcept {
  ifreq request{};
  interface_name.copy(request.ifr_name, IFNAMSIZ - 1);
  return request;
}

bool interface_is_up(int socket, const std::string& interface_name) noexcept {
  ifreq request = make_request(interface_name);
  return ::ioctl(socket, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) != 0;
}

template <typename T>
bool set_option(int socket, int level, int option, const T& value) noexcept {
  return ::setsockopt(socket, level, option, &value, sizeof(value)) == 0;
}

enum class OpenStep { kDone, kSocket, kInterface, kBind };

struct OpenedSocket {
  UniqueFd socket{};
  bool fd_frames = false;
  OpenStep failed_at = OpenStep::kDone;
  int error = 0;
};

OpenedSocket failed(OpenStep step) noexcept {
  return OpenedSocket{UniqueFd{}, false, step, errno};
}

/// Opens and binds; used at set-up (where the failure is told) and when the interface has to be found again.
OpenedSocket open_socket(const std::string& interface_name) noexcept {
  OpenedSocket opened;
  opened.socket = UniqueFd{::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC | SOCK_NONBLOCK, CAN_RAW)};
  if (!opened.socket) return failed(OpenStep::kSocket);
  const int fd = opened.socket.get();

  ifreq request = make_request(interface_name);
  if (::ioctl(fd, SIOCGIFINDEX, &request) != 0) return failed(OpenStep::kInterface);
  sockaddr_can address{};
  address.can_family = AF_CAN;
  address.can_ifindex = request.ifr_ifindex;

  request = make_request(interface_name);
  opened.fd_frames = ::ioctl(fd, SIOCGIFMTU, &request) == 0 && request.ifr_mtu >= static_cast<int>(CANFD_MTU) &&
                     set_option(fd, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, 1);
  set_option(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, can_err_mask_t{CAN_ERR_MASK});
  set_option(fd, SOL_SOCKET, SO_TIMESTAMPNS, 1);
  set_option(fd, SOL_SOCKET, SO_RXQ_OVFL, 1);
  // Root may have more than the system's limit, which is some 300 frames.
  if (!set_option(fd, SOL_SOCKET, SO_RCVBUFFORCE, kReceiveBytes)) {
    set_option(fd, SOL_SOCKET, SO_RCVBUF, kReceiveBytes);
  }
  if (::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0) return failed(OpenStep::kBind);
  return opened;
}

[[noreturn]] void throw_open_error(const std::string& interface_name, OpenStep failed_at, int error) {
  const std::string what =
      fmt::format("cannot open CAN interface \"{}\": {} ({})", interface_name, std::strerror(error), error);
  if (failed_at == OpenStep::kSocket && (error == EAFNOSUPPORT || error == EPROTONOSUPPORT)) {
    throw LinkError{what,
                    "this kernel has no CAN (\"modprobe can can-raw\" may help); without it use the embedded bus: "
                    "\"meltbench run SCENARIO\""};
  }
  if (failed_at == OpenStep::kInterface) {
    throw LinkError{what,
                    "see \"ip link\"; a virtual one: \"ip link add dev vcan0 type vcan && ip link set vcan0 up\"; "
                    "without hardware use the embedded bus: \"meltbench run SCENARIO\""};
  }
  throw LinkError{what, "run as a user who may open CAN sockets, or see \"dmesg\""};
}

}  // namespace

bool kernel_has_can() noexcept {
  return static_cast<bool>(UniqueFd{::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW)});
}

std::size_t to_kernel_frame(const can::CanFrame& frame, canfd_frame& kernel) noexcept {
  kernel = {};
  kernel.can_id = frame.id;
  if (frame.extended) kernel.can_id |= CAN_EFF_FLAG;
  if (frame.kind == can::FrameKind::kRemote) kernel.can_id |= CAN_RTR_FLAG;
  if (frame.kind == can::FrameKind::kError) kernel.can_id |= CAN_ERR_FLAG;
  kernel.len = frame.length;
  const auto data = frame.data();
  std::copy(data.begin(), data.end(), kernel.data);
  if (!frame.fd) {
    reinterpret_cast<can_frame&>(kernel).len8_dlc = frame.raw_dlc;
    return CAN_MTU;
  }
  kernel.flags = static_cast<__u8>((frame.brs ? CANFD_BRS : 0) | (frame.esi ? CANFD_ESI : 0));
  return CANFD_MTU;
}

std::optional<can::CanFrame> from_kernel_frame(const canfd_frame& kernel, std::size_t size) noexcept {
  if (size != CAN_MTU && size != CANFD_MTU) return std::nullopt;
  can::CanFrame frame;
  frame.fd = size == CANFD_MTU;
  if ((kernel.can_id & CAN_ERR_FLAG) != 0) {
    frame.kind = can::FrameKind::kError;
    frame.id = kernel.can_id & CAN_ERR_MASK;
  } else {
    frame.extended = (kernel.can_id & CAN_EFF_FLAG) != 0;
    frame.id = kernel.can_id & (frame.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    if ((kernel.can_id & CAN_RTR_FLAG) != 0) frame.kind = can::FrameKind::kRemote;
  }
  frame.length = kernel.len;
  if (frame.fd) {
    frame.brs = (kernel.flags & CANFD_BRS) != 0;
    frame.esi = (kernel.flags & CANFD_ESI) != 0;
  } else {
    frame.raw_dlc = reinterpret_cast<const can_frame&>(kernel).len8_dlc;
  }
  if (frame.length <= (frame.fd ? can::kMaxFdLength : can::kMaxClassicLength)) {
    std::copy_n(kernel.data, frame.data().size(), frame.bytes.begin());
  }
  if (!can::is_valid(frame)) return std::nullopt;
  return frame;
}

SocketCanLink::SocketCanLink(std::string interface_name) : interface_name_{std::move(interface_name)} {
  OpenedSocket opened = open_socket(interface_name_);
  if (!opened.socket) throw_open_error(interface_name_, opened.failed_at, opened.error);
  if (!interface_is_up(opened.socket.get(), interface_name_)) {
    throw LinkError{
        fmt::format("CAN interface \"{}\" is down", interface_name_),
        fmt::format("\"ip link set {} up type can bitrate 500000\" (a virtual one: without type and bitrate)",
                    interface_name_)};
  }
  socket_ = std::move(opened.socket);
  fd_frames_ = opened.fd_frames;
}

SocketCanLink::SocketCanLink(UniqueFd socket, std::string interface_name, bool fd_frames)
    : interface_name_{std::move(interface_name)}, socket_{std::move(socket)}, fd_frames_{fd_frames} {}

SendStatus SocketCanLink::send(const can::CanFrame& frame) noexcept {
  if (!up_) return SendStatus::kDown;
  if (frame.fd && !fd_frames_) return SendStatus::kUnsupported;
  canfd_frame kernel;
  const std::size_t size = to_kernel_frame(frame, kernel);
  const ssize_t written = ::send(socket_.get(), &kernel, size, MSG_NOSIGNAL | MSG_DONTWAIT);
  if (written == static_cast<ssize_t>(size)) return SendStatus::kSent;
  if (errno == ENOBUFS || errno == EAGAIN || errno == EINTR) {
    ++counters_.full;
    return SendStatus::kFull;
  }
  went_down(errno);
  return SendStatus::kDown;
}

std::optional<ReceivedFrame> SocketCanLink::receive() noexcept {
  while (socket_) {
    canfd_frame kernel{};
    iovec part{&kernel, sizeof(kernel)};
    alignas(cmsghdr) std::array<char, 128> control{};
    msghdr message{};
    message.msg_iov = &part;
    message.msg_iovlen = 1;
    message.msg_control = control.data();
    message.msg_controllen = control.size();
    const ssize_t size = ::recvmsg(socket_.get(), &message, MSG_DONTWAIT);
    if (size <= 0) {
      if (size == 0)
        went_down(ENODEV);  // Only a test's socket pair says so.
      else if (errno != EAGAIN && errno != EINTR)
        went_down(errno);
      return std::nullopt;
    }
    const auto frame = from_kernel_frame(kernel, static_cast<std::size_t>(size));
    if (!frame) continue;
    ReceivedFrame received{read_monotonic(), *frame};
    for (cmsghdr* item = CMSG_FIRSTHDR(&message); item != nullptr; item = CMSG_NXTHDR(&message, item)) {
      if (item->cmsg_level != SOL_SOCKET) continue;
      if (item->cmsg_type == SO_TIMESTAMPNS) {
        timespec stamp{};
        std::memcpy(&stamp, CMSG_DATA(item), sizeof(stamp));
        received.at_monotonic = to_monotonic(stamp);
      } else if (item->cmsg_type == SO_RXQ_OVFL) {
        std::uint32_t dropped = 0;
        std::memcpy(&dropped, CMSG_DATA(item), sizeof(dropped));
        counters_.dropped = dropped;
      }
    }
    if (received.frame.kind == can::FrameKind::kError) ++counters_.errors;
    return received;
  }
  return std::nullopt;
}

void SocketCanLink::went_down(int error) noexcept {
  if (up_) ++counters_.downs;
  up_ = false;
  // The interface is down: the socket stays bound and serves again. The interface is gone: only a new socket will.
  if (error != ENETDOWN) socket_ = UniqueFd{};
}

bool SocketCanLink::is_up() noexcept {
  if (up_) return true;
  if (!socket_) {
    OpenedSocket opened = open_socket(interface_name_);
    if (!opened.socket) return false;
    socket_ = std::move(opened.socket);
    fd_frames_ = opened.fd_frames;
  }
  up_ = interface_is_up(socket_.get(), interface_name_);
  return up_;
}

}  // namespace meltbench::link
