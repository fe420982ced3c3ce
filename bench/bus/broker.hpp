#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "protocols/link/bench_socket.hpp"
#include "protocols/runtime/bench_protocol.hpp"
#include "protocols/runtime/participant_port.hpp"

namespace meltbench::bus {

/// No answer for this long (wall clock) means that a participant hangs: a run must end within 2 s of that.
inline constexpr Nanos kWatchdog = 1500ms;

/// A program that has joined: what it said, and the socket to it.
struct Joined {
  runtime::Hello hello;
  link::BenchSocket socket;
};

/// Listens on an embedded bus until the programs of the run have joined.
class Broker {
 public:
  /// @throws link::LinkError if a bus of this name is running already.
  explicit Broker(std::string bus_name);
  ~Broker();
  Broker(const Broker&) = delete;
  Broker& operator=(const Broker&) = delete;

  /// Waits until programs with these names have joined.
  /// @param give_up  asked every 20 ms of wall-clock time; true ends the waiting.
  /// @returns them in the order of `names`, or nothing if given up.
  [[nodiscard]] std::optional<std::vector<Joined>> wait_for(std::span<const std::string> names,
                                                            const std::function<bool()>& give_up);

  /// A program that has joined since; nothing if there is none. Does not wait.
  [[nodiscard]] std::optional<Joined> take_newcomer();
  /// For poll(2): readable when a program connects.
  [[nodiscard]] int fd() const { return listener_.get(); }

  [[nodiscard]] const std::string& bus_name() const { return bus_name_; }

 private:
  void wait_for_news() const;
  /// The next program that has said who it is. Does not wait.
  [[nodiscard]] std::optional<Joined> take_hello();

  std::string bus_name_;
  link::UniqueFd listener_;
  std::deque<Joined> early_;               ///< Came while others were waited for.
  std::vector<link::BenchSocket> silent_;  ///< Newcomers that have not said hello yet.
};

/// Tells a program how time passes in this run, and so that it begins. @returns false if it has gone.
[[nodiscard]] bool welcome(Joined& joined, const link::Welcome& welcome);
/// Tells a program that the run is over.
void stop(Joined& joined);

/// Lockstep driver, the broker's side: the participant is a process, woken by one message and answering with one.
class SocketPort final : public runtime::ParticipantPort {
 public:
  /// @param joined  outlives the port.
  explicit SocketPort(Joined& joined);

  [[nodiscard]] std::string_view name() const override { return joined_.hello.name; }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return joined_.hello.signals; }
  [[nodiscard]] std::span<const std::string> nodes() const override { return joined_.hello.nodes; }
  [[nodiscard]] std::span<const std::string> lines() const override { return joined_.hello.lines; }
  [[nodiscard]] runtime::PortStatus wake(const Wakeup& in, Outbox& out, std::span<double> signals) override;

 private:
  Joined& joined_;
  link::MessageWriter writer_;
};

}  // namespace meltbench::bus
