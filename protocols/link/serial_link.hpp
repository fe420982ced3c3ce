#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "protocols/link/pseudo_terminal.hpp"
#include "protocols/link/unique_fd.hpp"
#include "protocols/serial/line_settings.hpp"
#include "protocols/time/instant.hpp"

struct sp_port;

namespace meltbench::link {

/// Bytes, and the CLOCK_MONOTONIC reading at which the last of them was there.
struct ReceivedBytes {
  Nanos at_monotonic{};
  std::span<const std::uint8_t> bytes;
};

/// A serial line as a program sees it. Never blocks, never throws: the loop reads a status.
class SerialLink {
 public:
  virtual ~SerialLink() = default;
  /// Takes as many bytes as there is room for. @returns how many; none while the line is down.
  [[nodiscard]] virtual std::size_t write(std::span<const std::uint8_t> bytes) noexcept = 0;
  /// The oldest bytes waiting; nothing: none wait. They stay valid until the next call.
  [[nodiscard]] virtual std::optional<ReceivedBytes> receive() noexcept = 0;
  /// Whether the line is there, as far as the last write() or receive() could tell.
  [[nodiscard]] virtual bool is_up() const noexcept = 0;
  /// Looks for a line that has gone. @returns whether it is there again.
  [[nodiscard]] virtual bool reopen() noexcept = 0;
  /// For poll(2): readable when bytes wait, or when the line has gone. May change after reopen(); -1 while there is
  /// nothing to wait for.
  [[nodiscard]] virtual int fd() const noexcept = 0;
};

/// A serial port of this machine.
///
///   /dev/ttyS1, /dev/serial/by-id/...   a real port, through libserialport: baud rate, parity, stop bits are set
///   /dev/pts/3, or a link to it         one end of somebody else's pseudo-terminal; it knows no baud rate
///   pty:/run/feeder                     makes a pseudo-terminal; others open its other end as /run/feeder
///
/// A port may vanish and come back (a USB adapter unplugged): meanwhile write() takes nothing, and reopen() opens
/// it again by its name, whatever device is behind the name by then. Opening forgets what was waiting in either
/// direction.
class SerialPort final : public SerialLink {
 public:
  /// @throws LinkError with the reason and what to do: no such port, no permission, in use, a setting that it refuses.
  SerialPort(std::string name, const serial::LineSettings& settings);

  [[nodiscard]] std::size_t write(std::span<const std::uint8_t> bytes) noexcept override;
  [[nodiscard]] std::optional<ReceivedBytes> receive() noexcept override;
  [[nodiscard]] bool is_up() const noexcept override { return fd_ >= 0; }
  [[nodiscard]] bool reopen() noexcept override { return is_up() || open().what.empty(); }
  [[nodiscard]] int fd() const noexcept override { return fd_; }

 private:
  struct CloseRealPort {
    void operator()(sp_port* port) const noexcept;
  };
  struct Failure {
    std::string what;  ///< Empty: none.
    std::string hint;
  };

  [[nodiscard]] Failure open() noexcept;
  [[nodiscard]] Failure open_real_port(const std::string& device) noexcept;
  [[nodiscard]] Failure open_pseudo_terminal(const std::string& device) noexcept;
  [[nodiscard]] Failure make_pseudo_terminal() noexcept;
  [[nodiscard]] bool has_hung_up() const noexcept;
  void close() noexcept;

  std::string name_;
  serial::LineSettings settings_;
  std::unique_ptr<sp_port, CloseRealPort> real_port_;
  UniqueFd foreign_terminal_;                   ///< One end of somebody else's pseudo-terminal.
  std::optional<PseudoTerminal> own_terminal_;  ///< Of "pty:".
  int fd_ = -1;                                 ///< Of the one that is open.
  std::array<std::uint8_t, 4096> buffer_{};
};

}  // namespace meltbench::link
