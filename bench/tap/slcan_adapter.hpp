#pragma once
/// A CAN adapter on a serial line, as its host sees it: what python-can's "slcan" interface, slcand and SavvyCAN expect
/// at the other end. The text of frames is in protocols/can/slcan.hpp.
///
///   V v N     versions and serial number     S0..S9 s...  bit rate: taken, the bus has its own
///   O  L  C   open, listen only, close       Z0 Z1        stamps of 16-bit milliseconds behind frames
///   t T r R d D b B   send a frame           X0 X1 P A    X0: frames wait to be asked for, one (P) or all (A)
///   F         status flags: bit 0 = frames that waited to be asked for were lost
///   M m       acceptance code and mask: only "everything" is taken
///
/// Everything is answered with a carriage return, or with BEL if refused; a frame with "z" or "Z" and a carriage return
/// while frames come unasked, which is how it starts. Opening twice and closing what is closed is no mistake:
/// python-can does both, and reads no answers.

#include <deque>

#include "bench/tap/dialect.hpp"

namespace meltbench::tap {

class SlcanAdapter final : public Dialect {
 public:
  /// @param read_only  refuse to send, as an adapter opened with L does.
  explicit SlcanAdapter(bool read_only) : read_only_{read_only} {}

  void greet(std::string&) const override {}
  [[nodiscard]] std::size_t hear(std::string_view said, std::size_t room, std::string& answers,
                                 std::vector<can::CanFrame>& sent) override;
  [[nodiscard]] bool wants_frames() const override { return open_; }
  void tell(const can::StampedFrame& frame, std::string& out) override;

 private:
  void obey(std::string_view line, std::string& answers, std::vector<can::CanFrame>& sent);
  [[nodiscard]] bool set_up(char command, std::string_view rest);
  void send(std::string_view line, std::string& answers, std::vector<can::CanFrame>& sent) const;
  [[nodiscard]] std::string take_waiting();

  bool read_only_;
  bool open_ = false;
  bool listen_only_ = false;
  bool unasked_ = true;  ///< Frames come unasked.
  bool stamps_ = false;
  bool overrun_ = false;
  std::deque<std::string> waiting_;  ///< To be asked for.
};

}  // namespace meltbench::tap
