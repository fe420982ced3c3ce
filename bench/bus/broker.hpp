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

/// Somebody who has asked something, and waits for answer().
struct Asked {
  runtime::Question question;
  link::BenchSocket socket;
};

/// Listens on an embedded bus: for the programs of the run, and for questions to it.
///
/// Who connects and says nothing, or nonsense, holds up nobody: up to kMaxSilent of them are kept, further ones wait
/// until one of those has spoken or gone.
class Broker {
 public:
  static constexpr std::size_t kMaxSilent = 64;

  /// @param about  what it answers to who asks which run this is.
  /// @throws link::LinkError if a bus of this name is running already.
  explicit Broker(std::string bus_name, std::string about = {});
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
  /// A question that has come since, of kRun none: those are answered already. Does not wait.
  [[nodiscard]] std::optional<Asked> take_question();
  /// For poll(2): readable when a program connects.
  [[nodiscard]] int fd() const { return listener_.get(); }

  [[nodiscard]] const std::string& bus_name() const { return bus_name_; }

 private:
  void wait_for_news() const;
  void look();
  void sort(link::BenchSocket socket, std::span<const std::uint8_t> message);

  std::string bus_name_;
  link::UniqueFd listener_;
  std::string about_;
  std::deque<Joined> came_;                ///< Not yet taken.
  std::deque<Asked> asked_;                ///< Not yet taken.
  std::vector<link::BenchSocket> silent_;  ///< Have not said anything yet.
};

/// Tells a program how time passes in this run, and so that it begins. @returns false if it has gone.
[[nodiscard]] bool welcome(Joined& joined, const link::Welcome& welcome);
/// Answers a question. Who does not take the answer goes without.
void answer(Asked& asked, const runtime::Answer& answer);
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
