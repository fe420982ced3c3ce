#pragma once
/// Tools of an NMT manager: commands, SYNC and heartbeat production, PDO configuration, a queue of SDO steps. Which
/// node is booted when, and what then happens, is the machine's business, not decided here.

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "protocols/canopen/pdo.hpp"
#include "protocols/canopen/sdo_client.hpp"
#include "protocols/canopen/types.hpp"

namespace meltbench::canopen {

/// NMT command. @param node  1..127, or 0 for all nodes.
[[nodiscard]] can::CanFrame make_nmt_command(NmtCommand command, std::uint8_t node);

/// SYNC, with a counter (1..240) if 0x1019 asks for one.
[[nodiscard]] can::CanFrame make_sync(std::optional<std::uint8_t> counter = {});

/// Something sent every period, on a grid that does not drift: SYNC or heartbeat.
class PeriodicTimer {
 public:
  /// First due at `first`. @pre period > 0.
  void start(Instant first, Nanos period);
  void stop() { due_ = Instant::never(); }

  /// True once for each period that has come; periods missed by a late caller are skipped and counted.
  bool take(Instant now);
  [[nodiscard]] Instant next_deadline() const { return due_; }
  [[nodiscard]] std::uint64_t missed() const { return missed_; }

 private:
  Instant due_ = Instant::never();
  Nanos period_{};
  std::uint64_t missed_ = 0;
};

/// One thing to do by SDO. A write writes `value`; an expectation reads and compares with `value`.
struct SdoStep {
  enum class Kind : std::uint8_t { kWrite, kExpect, kRead };
  Kind kind = Kind::kWrite;
  ObjectAddress address;
  std::vector<std::uint8_t> value;
  std::string purpose;  ///< For the message if it fails: "identity: product code".
};

template <class T>
[[nodiscard]] SdoStep write_step(std::uint16_t index, std::uint8_t sub, T value, std::string purpose = {}) {
  return {SdoStep::Kind::kWrite, {index, sub}, to_bytes(value), std::move(purpose)};
}
template <class T>
[[nodiscard]] SdoStep expect_step(std::uint16_t index, std::uint8_t sub, T value, std::string purpose = {}) {
  return {SdoStep::Kind::kExpect, {index, sub}, to_bytes(value), std::move(purpose)};
}

/// What a master wants of one PDO of a node.
struct PdoConfiguration {
  struct Item {
    ObjectAddress address;
    std::uint8_t bits = 0;
  };
  PdoDirection direction = PdoDirection::kTransmit;  ///< Seen from the node.
  unsigned number = 1;
  std::uint32_t id = 0;  ///< COB-ID, 11 or (extended) 29 bits.
  bool extended = false;
  std::uint8_t type = kEventProfile;
  std::optional<std::uint16_t> inhibit_100us;  ///< Written only if given.
  std::optional<std::uint16_t> event_ms;
  std::optional<std::uint8_t> sync_start;
  std::vector<Item> mapping;  ///< Empty: the mapping is left as it is.

  /// Appends the writes in the order that CiA 301 asks for: off, parameters, mapping closed, entries, opened, on.
  void append_steps(std::vector<SdoStep>& steps) const;
  [[nodiscard]] std::uint8_t length() const;  ///< Bytes of the mapping.
};

/// Works off a list of SDO steps against one node, one after the other, and stops at the first that fails.
class ConfigurationQueue {
 public:
  enum class Status : std::uint8_t { kIdle, kBusy, kDone, kFailed };

  /// @param node  id 1..127.  @param name  of the node in messages.  @param timeout  per transfer.
  ConfigurationQueue(std::uint8_t node, std::string name, Nanos timeout = kDefaultSdoTimeout);

  /// Begins; a running list is cancelled. An empty list is done at once.
  void start(Instant now, std::vector<SdoStep> steps, Frames& out);
  void on_frame(Instant now, const can::CanFrame& frame, Frames& out);
  void on_time(Instant now, Frames& out);
  void cancel(Instant now, Frames& out);
  [[nodiscard]] Instant next_deadline() const { return client_.next_deadline(); }

  [[nodiscard]] Status status() const { return status_; }
  /// What failed, in words: `feeder (node 3): identity: 0x1018:2 is 0x00000007, expected 0x00000008`. Empty if nothing
  /// has.
  [[nodiscard]] const std::string& failure() const { return failure_; }
  [[nodiscard]] std::size_t steps_done() const { return next_; }
  [[nodiscard]] std::size_t step_count() const { return steps_.size(); }
  /// Value of a kRead (or kExpect) step that is done. @pre step < steps_done().
  [[nodiscard]] std::span<const std::uint8_t> value_read(std::size_t step) const { return steps_[step].value; }
  /// The last transfer, for its time and abort code.
  [[nodiscard]] const SdoResult& last_result() const { return client_.result(); }

 private:
  void begin_step(Instant now, Frames& out);
  void conclude(Instant now, Frames& out);
  void fail(std::string what);

  std::string name_;
  SdoClient client_;
  std::vector<SdoStep> steps_;
  std::size_t next_ = 0;
  Status status_ = Status::kIdle;
  std::string failure_;
};

}  // namespace meltbench::canopen
