#pragma once
/// The socketcand protocol, server side: what python-can's "socketcand" interface, SavvyCAN and Kayak speak over TCP.
///
///   server: < hi >
///   client: < open can0 >       server: < ok >      any name: a tap has one bus
///   client: < rawmode >         server: < ok >      from here on the bus is shown
///   server: < frame 185 12.340000 1122334455667788 >    id in 3 or 8 digits (8 = extended), time of the run, data
///   server: < error 004 12.340000 >                      an error frame, with its class
///   client: < send 605 8 40 0 10 0 0 0 0 0 >             id, number of bytes, bytes
///   client: < echo >            server: < echo >
///
/// Source: socketcand's doc/protocol.md. Its BCM, control and ISO-TP modes are answered with an error; remote frames
/// and FD frames cannot be said in raw mode and are left out. What real clients need, tried with python-can 4.1.0:
/// - It sends identifiers without leading zeros; SavvyCAN adds bit 31 to extended ones. So an identifier is extended if
///   it has 8 digits or does not fit 11 bits, and is cut to 29 bits.
/// - SavvyCAN prints bytes from 80 on, and numbers with bit 31, as negative ones: FFFFFFFFFFFFFF80.
/// - It loses a character behind what it has read: a line end follows each message of raw mode, as something to lose.
/// - It compares "< hi >" and "< ok >" with all that it reads at once: nothing may follow them in the same packet.

#include <optional>

#include "bench/tap/dialect.hpp"

namespace meltbench::tap {

class Socketcand final : public Dialect {
 public:
  /// @param read_only  answer "send" with an error.
  explicit Socketcand(bool read_only) : read_only_{read_only} {}

  void greet(std::string& answers) const override { answers += "< hi >"; }
  [[nodiscard]] std::size_t hear(std::string_view said, std::size_t room, std::string& answers,
                                 std::vector<can::CanFrame>& sent) override;
  [[nodiscard]] bool wants_frames() const override { return state_ == State::kRaw; }
  void tell(const can::StampedFrame& frame, std::string& out) override;

 private:
  enum class State { kNoBus, kOpen, kRaw };

  void obey(std::string_view message, std::string& answers, std::vector<can::CanFrame>& sent);

  bool read_only_;
  State state_ = State::kNoBus;
};

/// Reads the words behind "send": "605 8 40 0 10 0 0 0 0 0".
/// @returns nothing if that is not one classic data frame.
[[nodiscard]] std::optional<can::CanFrame> parse_send(std::string_view words);

}  // namespace meltbench::tap
