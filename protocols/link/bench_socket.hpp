#pragma once
/// The socket of an embedded bus: SEQPACKET, in a directory that only its owner can enter.

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/link/can_link.hpp"
#include "protocols/link/unique_fd.hpp"

namespace meltbench::link {

/// The folder of all embedded buses of this user: $XDG_RUNTIME_DIR/meltbench, else <temporary folder>/meltbench-<uid>.
/// Made with mode 0700 if it is not there.
/// @throws LinkError if it is not ours alone (another owner, a symbolic link, open to others).
[[nodiscard]] std::string embedded_bus_folder();

/// Opens the socket that the broker of bus `name` listens on. A socket left by a broker that died is replaced.
/// @throws LinkError if a bus of this name is running already.
[[nodiscard]] UniqueFd listen_embedded_bus(std::string_view name);

/// Removes the socket's name again; what is connected stays so.
void remove_embedded_bus(std::string_view name) noexcept;

/// Names of the embedded buses of this user, in alphabetic order; of a broker that was killed, too.
[[nodiscard]] std::vector<std::string> list_embedded_buses();

/// Connects to the broker of bus `name`.
/// @throws LinkError if there is none.
[[nodiscard]] UniqueFd connect_embedded_bus(std::string_view name);

/// Outcome of waiting for a message.
enum class ReceiveStatus : std::uint8_t { kMessage, kTimeout, kClosed, kInterrupted };

/// One end of a connection: whole messages in, whole messages out.
class BenchSocket {
 public:
  explicit BenchSocket(UniqueFd socket);

  /// Blocks while the other end's queue is full. @returns false if the other end is gone.
  [[nodiscard]] bool send(std::span<const std::uint8_t> message) noexcept;
  /// As send(), but kFull at once when the queue is full: for whoever must never wait for a slow reader.
  [[nodiscard]] SendStatus try_send(std::span<const std::uint8_t> message) noexcept;

  /// Waits for one message, at most as long as set_timeout() says. It stays valid until the next call.
  [[nodiscard]] ReceiveStatus receive(std::span<const std::uint8_t>& message) noexcept;
  /// As receive(), without waiting.
  [[nodiscard]] ReceiveStatus try_receive(std::span<const std::uint8_t>& message) noexcept;

  /// Zero: wait for ever (the state after construction).
  void set_timeout(Nanos timeout) noexcept;
  [[nodiscard]] int fd() const noexcept { return socket_.get(); }

 private:
  ReceiveStatus receive(std::span<const std::uint8_t>& message, int flags) noexcept;

  UniqueFd socket_;
  std::vector<std::uint8_t> buffer_;
};

}  // namespace meltbench::link
