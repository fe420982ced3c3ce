#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "protocols/link/bench_socket.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/link/serial_link.hpp"
#include "protocols/participant/serial_inbox.hpp"
#include "protocols/runtime/bench_protocol.hpp"

namespace meltbench::runtime {

/// A connection to a broker that has welcomed us.
struct JoinedBench {
  link::BenchSocket socket;
  link::Welcome welcome;
};

/// Says hello to the broker of bus `bus_name` and waits for its welcome.
/// @returns nothing if the broker went away, or we were told to stop, before.
/// @throws link::LinkError if there is no such bus.
[[nodiscard]] std::optional<JoinedBench> join_bench(const Hello& hello, const std::string& bus_name);

class BenchClient;

/// A serial line that the embedded bus carries. Its bytes come over the client's socket: whoever reads that hands them
/// over here, so it has no descriptor of its own.
class BenchLine final : public link::SerialLink {
 public:
  BenchLine(BenchClient& client, std::uint8_t number) : client_{client}, number_{number} {}

  [[nodiscard]] std::size_t write(std::span<const std::uint8_t> bytes) noexcept override;
  [[nodiscard]] std::optional<link::ReceivedBytes> receive() noexcept override;
  [[nodiscard]] bool is_up() const noexcept override;
  [[nodiscard]] bool reopen() noexcept override { return is_up(); }
  [[nodiscard]] int fd() const noexcept override { return -1; }
  void add(const SerialArrival& piece) { arrived_.add(piece.at, 0, piece.bytes); }

 private:
  BenchClient& client_;
  std::uint8_t number_;
  SerialInbox arrived_;  ///< Stamped on CLOCK_MONOTONIC.
  std::size_t read_ = 0;
};

/// A program's connection to the broker in wall-clock time: the embedded bus as a CanLink, the serial lines that it
/// carries, and reports beside them.
class BenchClient final : public link::CanLink {
 public:
  /// @param socket  connected and welcomed.  @param line_count  of the participant's lines.
  explicit BenchClient(link::BenchSocket socket, std::size_t line_count = 0);

  [[nodiscard]] link::SendStatus send(const can::CanFrame& frame) noexcept override { return send_as(0, frame); }
  [[nodiscard]] link::SendStatus send_as(std::uint8_t node, const can::CanFrame& frame) noexcept override;
  [[nodiscard]] std::optional<link::ReceivedFrame> receive() noexcept override;
  [[nodiscard]] bool is_up() noexcept override { return !lost_; }
  [[nodiscard]] int fd() const noexcept override { return socket_.fd(); }
  [[nodiscard]] const link::LinkCounters& counters() const noexcept override { return counters_; }

  /// States of the participant's nodes, as last told; empty on an ideal bus. They come with receive().
  [[nodiscard]] std::span<const can::ErrorState> node_states() const { return node_states_; }
  /// Whether they have been told since the last call.
  [[nodiscard]] bool take_node_change() { return std::exchange(nodes_told_, false); }

  /// States of the participant's serial lines that the bench has told, in their order; empty: no plug was ever pulled.
  [[nodiscard]] std::span<const LinkState> line_states() const { return line_states_; }
  /// Whether they have been told since the last call.
  [[nodiscard]] bool take_line_change() { return std::exchange(lines_told_, false); }
  /// What the bench asks of the participant, oldest first, since clear_orders().
  [[nodiscard]] std::span<const std::string> orders() const { return orders_; }
  void clear_orders() { orders_.clear(); }

  /// A serial line by its number in the participant's lines(). Its bytes arrive with receive() or poll_stop().
  [[nodiscard]] BenchLine& line(std::size_t number) { return *lines_[number]; }
  /// @returns whether the bench took them.
  [[nodiscard]] bool send_serial(std::uint8_t line, std::span<const std::uint8_t> bytes) noexcept;

  /// Sends what is to be recorded; dropped when the broker does not keep up.
  void report(Instant at, std::span<const Event> events, std::span<const double> signals) noexcept;
  void report_timing(const LogHistogram& lateness) noexcept;
  /// Looks for a Stop; call it where receive() is not called.
  void poll_stop() noexcept;
  [[nodiscard]] bool stopped() const noexcept { return stopped_; }
  [[nodiscard]] bool lost() const noexcept { return lost_; }

 private:
  static constexpr std::size_t kUsualMessageSize = 16 * 1024;  // Frames, signals and lateness; events come on top.

  link::BenchSocket socket_;
  link::MessageWriter writer_;
  link::LinkCounters counters_;
  std::vector<std::unique_ptr<BenchLine>> lines_;
  std::vector<can::ErrorState> node_states_;
  bool nodes_told_ = false;
  std::vector<LinkState> line_states_;
  bool lines_told_ = false;
  std::vector<std::string> orders_;
  bool stopped_ = false;
  bool lost_ = false;
};

}  // namespace meltbench::runtime
