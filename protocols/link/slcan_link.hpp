#pragma once

#include <string>

#include "protocols/can/slcan.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/link/serial_link.hpp"

namespace meltbench::link {

/// A CAN bus behind an adapter on a serial port that speaks slcan, for hosts whose kernel has no CAN.
///
/// It sets the bit rate, opens the channel, and from then on never waits for an answer: some adapters give none, some
/// late. What an adapter refuses after it was sent (BEL) is counted as refused. Frames are stamped when they are read.
/// FD frames are sent as they are: an adapter that cannot carry them refuses them. Once per second it asks for the
/// adapter's status flags, unless the adapter does not know them; they tell of frames that it lost and of bus errors.
/// A serial queue that takes no more is kFull. The port may vanish and come back: see SerialPort.
class SlcanLink final : public CanLink {
 public:
  /// On a UART, which has a rate of its own; a USB adapter does not care.
  static constexpr std::uint32_t kBaudRate = 115'200;

  /// @param port  as SerialPort takes it.  @param bit_rate_bit_per_s  one that slcan has a digit for.
  /// @throws LinkError: the port cannot be opened, or there is no such bit rate.
  SlcanLink(std::string port, std::uint32_t bit_rate_bit_per_s);
  /// Closes the channel.
  ~SlcanLink() override;
  SlcanLink(const SlcanLink&) = delete;
  SlcanLink& operator=(const SlcanLink&) = delete;

  [[nodiscard]] SendStatus send(const can::CanFrame& frame) noexcept override;
  [[nodiscard]] std::optional<ReceivedFrame> receive() noexcept override;
  [[nodiscard]] bool is_up() noexcept override;
  [[nodiscard]] int fd() const noexcept override { return port_.fd(); }
  [[nodiscard]] const LinkCounters& counters() const noexcept override { return counters_; }

 private:
  void open_channel() noexcept;
  void write(std::string_view text) noexcept;
  /// Goes on with a line that the port has taken only a part of. @returns true if nothing of it is left.
  bool finish_line() noexcept;
  void ask_for_flags() noexcept;
  void take_answer(std::string_view line) noexcept;
  void note_down() noexcept;

  SerialPort port_;
  std::string opening_;
  can::SlcanLines lines_;
  std::string text_;       ///< The line being written: its memory, and
  std::size_t taken_ = 0;  ///< how much of it the port has taken.
  Nanos received_at_{};
  bool up_ = true;
  bool told_down_ = true;  ///< is_up() has said so since the port went.
  Nanos next_flags_{};
  bool flags_asked_ = false;
  bool flags_known_ = false;    ///< The adapter has told them once.
  bool flags_refused_ = false;  ///< The adapter does not know them.
  LinkCounters counters_;
};

}  // namespace meltbench::link
