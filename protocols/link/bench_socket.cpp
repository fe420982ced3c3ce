#include "protocols/link/bench_socket.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "protocols/link/bench_message.hpp"

namespace meltbench::link {
namespace {

constexpr std::string_view kExtension = ".bus";
constexpr Nanos kConnectPatience = 5s;  // With a broker that takes nobody: it hangs, or has been stopped.

std::string socket_path(std::string_view name) {
  return fmt::format("{}/{}{}", embedded_bus_folder(), name, kExtension);
}

sockaddr_un make_address(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.size() >= sizeof(address.sun_path)) {
    throw LinkError{fmt::format("the path of the embedded bus is too long for a socket: {}", path),
                    "set XDG_RUNTIME_DIR to a folder with a shorter name"};
  }
  path.copy(address.sun_path, sizeof(address.sun_path) - 1);
  return address;
}

UniqueFd make_socket(int flags = 0) {
  UniqueFd socket{::socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | flags, 0)};
  if (!socket) throw LinkError{fmt::format("cannot make a socket: {}", std::strerror(errno)), "see \"ulimit -n\""};
  return socket;
}

bool connect_to(const UniqueFd& socket, const sockaddr_un& address) {
  return ::connect(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
}

/// Whether somebody listens there. Does not wait for one that is stopped or hangs, whose queue is full (EAGAIN).
bool is_served(const std::string& path) {
  return connect_to(make_socket(SOCK_NONBLOCK), make_address(path)) || errno != ECONNREFUSED;
}

void set_send_timeout(const UniqueFd& socket, Nanos timeout) {
  const timeval value{timeout / 1s, timeout % 1s / 1us};
  ::setsockopt(socket.get(), SOL_SOCKET, SO_SNDTIMEO, &value, sizeof(value));
}

/// Removes the sockets of brokers that were killed: nobody listens on them any more.
void remove_orphans(const std::string& folder) {
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator{folder, error}) {
    if (entry.path().extension() != kExtension) continue;
    if (!is_served(entry.path().string())) ::unlink(entry.path().c_str());
  }
}

}  // namespace

std::string embedded_bus_folder() {
  const char* runtime = std::getenv("XDG_RUNTIME_DIR");
  const std::string folder =
      runtime != nullptr && *runtime != '\0'
          ? fmt::format("{}/meltbench", runtime)
          : fmt::format("{}/meltbench-{}", std::filesystem::temp_directory_path().string(), ::getuid());
  if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST) {
    throw LinkError{fmt::format("cannot make {}: {}", folder, std::strerror(errno)),
                    "set XDG_RUNTIME_DIR to a folder that you may write to"};
  }
  struct stat status {};
  if (::lstat(folder.c_str(), &status) != 0 || !S_ISDIR(status.st_mode) || status.st_uid != ::getuid() ||
      (status.st_mode & 0077) != 0) {
    throw LinkError{fmt::format("{} is not a folder of yours alone (mode 0700)", folder),
                    "remove it, or set XDG_RUNTIME_DIR to another place"};
  }
  return folder;
}

UniqueFd listen_embedded_bus(std::string_view name) {
  remove_orphans(embedded_bus_folder());
  const std::string path = socket_path(name);
  const sockaddr_un address = make_address(path);
  if (std::filesystem::exists(path)) {
    throw LinkError{fmt::format("an embedded bus named \"{}\" is running already", name),
                    "end that run, or name this one otherwise: --can virtual:OTHER"};
  }
  UniqueFd socket = make_socket();
  if (::bind(socket.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) != 0 ||
      ::listen(socket.get(), 16) != 0) {
    throw LinkError{fmt::format("cannot listen on {}: {}", path, std::strerror(errno)), "is the disk full?"};
  }
  return socket;
}

std::vector<std::string> list_embedded_buses() {
  std::vector<std::string> names;
  for (const auto& entry : std::filesystem::directory_iterator{embedded_bus_folder()}) {
    if (entry.path().extension() == kExtension) names.push_back(entry.path().stem().string());
  }
  std::ranges::sort(names);
  return names;
}

void remove_embedded_bus(std::string_view name) noexcept {
  try {
    ::unlink(socket_path(name).c_str());
  } catch (const std::exception&) {  // The folder is gone: so is the socket.
  }
}

UniqueFd connect_embedded_bus(std::string_view name) {
  const std::string path = socket_path(name);
  UniqueFd socket = make_socket();
  set_send_timeout(socket, kConnectPatience);
  if (!connect_to(socket, make_address(path))) {
    throw LinkError{fmt::format("there is no embedded bus named \"{}\" ({}: {})", name, path, std::strerror(errno)),
                    "\"meltbench run\" starts one; without it use a kernel interface, e.g. --can vcan0"};
  }
  set_send_timeout(socket, 0s);
  return socket;
}

BenchSocket::BenchSocket(UniqueFd socket) : socket_{std::move(socket)}, buffer_(kMaxMessageSize) {
  const int size = static_cast<int>(2 * kMaxMessageSize);
  ::setsockopt(socket_.get(), SOL_SOCKET, SO_SNDBUF, &size, sizeof(size));
}

bool BenchSocket::send(std::span<const std::uint8_t> message) noexcept {
  while (true) {
    if (::send(socket_.get(), message.data(), message.size(), MSG_NOSIGNAL) >= 0) return true;
    if (errno != EINTR) return false;
  }
}

SendStatus BenchSocket::try_send(std::span<const std::uint8_t> message) noexcept {
  if (::send(socket_.get(), message.data(), message.size(), MSG_NOSIGNAL | MSG_DONTWAIT) >= 0) return SendStatus::kSent;
  return errno == EAGAIN || errno == EINTR || errno == ENOBUFS ? SendStatus::kFull : SendStatus::kDown;
}

ReceiveStatus BenchSocket::receive(std::span<const std::uint8_t>& message, int flags) noexcept {
  ssize_t size = ::recv(socket_.get(), buffer_.data(), buffer_.size(), flags);
  // Said once when the other end has gone with something of ours unread; what it had sent before still waits.
  if (size < 0 && errno == ECONNRESET) size = ::recv(socket_.get(), buffer_.data(), buffer_.size(), flags);
  if (size > 0) {
    message = {buffer_.data(), static_cast<std::size_t>(size)};
    return ReceiveStatus::kMessage;
  }
  if (size == 0) return ReceiveStatus::kClosed;
  if (errno == EINTR) return ReceiveStatus::kInterrupted;
  return errno == EAGAIN ? ReceiveStatus::kTimeout : ReceiveStatus::kClosed;
}

ReceiveStatus BenchSocket::receive(std::span<const std::uint8_t>& message) noexcept {
  return receive(message, 0);
}

ReceiveStatus BenchSocket::try_receive(std::span<const std::uint8_t>& message) noexcept {
  return receive(message, MSG_DONTWAIT);
}

void BenchSocket::set_timeout(Nanos timeout) noexcept {
  const timeval value{timeout / 1s, timeout % 1s / 1us};
  ::setsockopt(socket_.get(), SOL_SOCKET, SO_RCVTIMEO, &value, sizeof(value));
}

}  // namespace meltbench::link
