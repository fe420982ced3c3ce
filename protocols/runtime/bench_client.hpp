#pragma once

#include "protocols/link/bench_socket.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/bench_protocol.hpp"

namespace meltbench::runtime {

/// A program's connection to the broker in wall-clock time: the embedded bus as a CanLink, and reports beside it.
class BenchClient final : public link::CanLink {
 public:
  /// @param socket  connected and welcomed.
  explicit BenchClient(link::BenchSocket socket) : socket_{std::move(socket)} { writer_.reserve(kUsualMessageSize); }

  [[nodiscard]] link::SendStatus send(const can::CanFrame& frame) noexcept override;
  [[nodiscard]] std::optional<link::ReceivedFrame> receive() noexcept override;
  [[nodiscard]] bool is_up() noexcept override { return !lost_; }
  [[nodiscard]] int fd() const noexcept override { return socket_.fd(); }
  [[nodiscard]] const link::LinkCounters& counters() const noexcept override { return counters_; }

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
  bool stopped_ = false;
  bool lost_ = false;
};

}  // namespace meltbench::runtime
