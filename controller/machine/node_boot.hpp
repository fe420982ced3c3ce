#pragma once
/// Brings one board from whatever state to configured.

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "controller/machine/boot_plan.hpp"
#include "protocols/canopen/manager.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::machine {

/// How long to wait for a board.
struct BootTimes {
  Nanos boot_timeout = 5s;    ///< From begin() to done.
  Nanos sdo_timeout = 100ms;  ///< Per transfer.
};

/// One board's way: boot-up message -> identity -> configuration -> (drive) Operation enabled at speed -> done.
/// All boards go this way at once, each with its own NodeBoot. The node is left Pre-operational; to start it is the
/// manager's business, when all are done.
///
/// A transfer that times out begins the configuration anew; a board that resets on the way, too; a board that is silent
/// is reset again every kResetInterval. All of that ends with the boot time-out. A wrong identity and a refused value
/// end it at once.
class NodeBoot {
 public:
  enum class Phase : std::uint8_t {
    kIdle,
    kWaiting,  ///< For the boot-up message.
    kConfiguring,
    kEnabling,  ///< Drive: 402 state machine, then until the speed is reached.
    kDone,
    kFailed,
  };

  /// @param label  in messages: "feeder (node 5)".
  NodeBoot(std::string label, std::uint8_t node_id, BootPlan plan, const BootTimes& times);

  /// Boot starts now: the time-out runs. The reset of communication has been sent to all by the caller.
  void begin(Instant now, canopen::Frames& out);

  /// A boot-up message has come. Acts with the next on_time(), so that of several at one instant only the last counts.
  void on_boot_up(Instant now, canopen::Frames& out);
  void on_frame(Instant now, const can::CanFrame& frame, canopen::Frames& out);
  void on_time(Instant now, canopen::Frames& out);
  [[nodiscard]] Instant next_deadline() const;

  [[nodiscard]] Phase phase() const { return phase_; }
  /// Why it failed: "boot-timeout", "identity-mismatch" or "configuration-failed", and in words. @pre kFailed.
  [[nodiscard]] std::string_view failure_code() const { return failure_code_; }
  [[nodiscard]] const std::string& failure() const { return failure_; }
  [[nodiscard]] std::uint64_t sdo_timeouts() const { return sdo_timeouts_; }

  /// What a step of the plan has read. @pre configured, and the plan reads that object as a T.
  template <class T>
  [[nodiscard]] T value(canopen::ObjectAddress address) const {
    return canopen::load<T>(find_value(address));
  }

  /// Writes something later, in the run; failures show in take_failure(). @pre kDone.
  void write(Instant now, std::vector<canopen::SdoStep> steps, canopen::Frames& out);
  /// A write() is under way.
  [[nodiscard]] bool is_writing() const { return list_runs_; }
  /// What step `step` of the last write() has read; nothing if it has not, or not as a T. @pre !is_writing().
  template <class T>
  [[nodiscard]] std::optional<T> read_later(std::size_t step) const {
    if (queue_.status() == canopen::ConfigurationQueue::Status::kFailed) return {};
    const auto value = queue_.value_read(step);
    if (value.size() != sizeof(T)) return {};
    return canopen::load<T>(value);
  }
  /// Why the last write() failed, told once.
  [[nodiscard]] std::optional<std::string> take_failure();

  static constexpr Nanos kResetInterval = 250ms;

 private:
  static constexpr Nanos kSettleTime = 10ms;  // Answers under way to requests given up have then come.
  static constexpr Nanos kPollInterval = 5ms;

  void begin_list(Instant now, canopen::Frames& out);
  void conclude_list(Instant now);
  void on_drive_status(Instant now);
  void restart(Instant at);
  void fail(std::string_view code, std::string why);
  [[nodiscard]] std::vector<canopen::SdoStep> make_enable_steps() const;
  [[nodiscard]] std::span<const std::uint8_t> find_value(canopen::ObjectAddress address) const;
  [[nodiscard]] std::int32_t target_inc_per_s() const;
  [[nodiscard]] std::string what_it_waits_for() const;

  std::string label_;
  std::uint8_t node_id_;
  BootPlan plan_;  // Its read steps hold what was read, once configured.
  BootTimes times_;
  canopen::ConfigurationQueue queue_;
  Phase phase_ = Phase::kIdle;
  bool list_runs_ = false;
  Instant act_at_ = Instant::never();  // Next list, reset or poll.
  Instant deadline_ = Instant::never();
  std::optional<std::uint16_t> controlword_;  // To be written with the next list; the last one written.
  bool write_controlword_ = false;
  bool target_written_ = false;
  std::string drive_state_;
  std::string last_trouble_;
  std::string_view failure_code_;
  std::string failure_;
  std::uint64_t sdo_timeouts_ = 0;
};

}  // namespace meltbench::machine
