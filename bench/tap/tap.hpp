#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "bench/bus/outside.hpp"
#include "bench/tap/visitor.hpp"
#include "protocols/link/pseudo_terminal.hpp"

namespace meltbench::tap {

/// Where other people's programs may come in.
struct TapOptions {
  std::string socketcand;    ///< "29536": that port on 127.0.0.1, 0: one that is free; "unix:/path"; empty: not at all.
  std::string slcan_pty;     ///< Path at which to put a pseudo-terminal that is an slcan adapter; empty: none.
  bool read_only = false;    ///< They may look, and are told so when they send.
  std::string kernel_bus{};  ///< Kernel interface that shows the bus, too: "vcan0"; empty: none.

  [[nodiscard]] bool is_wanted() const { return !socketcand.empty() || !slcan_pty.empty() || !kernel_bus.empty(); }
};

/// Lets other people's CAN programs look at the embedded bus of a run and talk on it: in the socketcand protocol, as
/// hosts of an slcan adapter, or on a kernel interface.
///
/// A client sees every frame but its own, as on a kernel bus, from the moment at which it asks to. It never delays the
/// run: what it does not read waits for it up to kMaxBacklog bytes; further frames are lost for this client alone, and
/// counted. It stays connected; once it reads on it gets what waits, and then the bus of that moment.
class Tap final : public bus::Outside {
 public:
  /// @throws link::LinkError if the address cannot be listened on, or is none, or the interface cannot be opened.
  explicit Tap(const TapOptions& options);
  ~Tap() override;
  Tap(const Tap&) = delete;
  Tap& operator=(const Tap&) = delete;

  /// One more who looks on and may send.
  void admit(std::unique_ptr<Visitor> visitor);

  void exchange(std::size_t room, std::vector<can::CanFrame>& frames) override;
  void show(const can::StampedFrame& frame, std::size_t sender) override;
  void watch(std::vector<pollfd>& watched) const override;

  /// Waits until so many clients look at the bus. @param give_up  asked every 50 ms; true ends the waiting.
  void wait_for(std::size_t clients, const std::function<bool()>& give_up);

  /// After the last frame: lets clients read what waits for them, then closes. Ends when none has read for `patience`,
  /// and after ten seconds in any case.
  void drain(Nanos patience);

  /// How to reach it: "socketcand on 127.0.0.1:29536", "slcan on /tmp/slcan".
  [[nodiscard]] const std::vector<std::string>& places() const { return places_; }
  /// One line for each one that lost frames, complete after drain().
  [[nodiscard]] const std::vector<std::string>& complaints() const { return complaints_; }

 private:
  struct Guest {
    std::uint64_t number = 0;
    std::unique_ptr<Visitor> visitor;
    bool at_pty = false;
  };
  struct Sent {
    std::uint64_t guest = 0;
    can::CanFrame frame;
  };

  void accept_clients();
  void look_at_pty();
  void remove_gone();
  void note_losses(const Visitor& visitor);
  [[nodiscard]] std::uint64_t take_sender_of(const can::CanFrame& frame);
  void wait(Nanos at_most) const;

  bool read_only_;
  std::string unix_path_;  ///< To be removed at the end; empty for TCP.
  std::vector<std::string> places_;
  link::UniqueFd listener_;
  std::optional<link::PseudoTerminal> pty_;
  bool pty_in_use_ = false;
  std::vector<Guest> guests_;
  std::uint64_t next_number_ = 1;
  std::deque<Sent> on_their_way_;  ///< Taken from a client, not yet seen on the bus.
  std::vector<std::string> complaints_;
};

}  // namespace meltbench::tap
