#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bench/replay/script.hpp"

namespace meltbench::replay {

/// How far an answer may be from the recorded one.
struct Tolerance {
  Nanos time{1ms};
  /// Of a value in a PDO, by object: {node id, address}; an object that is not here must be equal.
  std::map<std::pair<std::uint8_t, canopen::ObjectAddress>, double> values;
};

/// In what one answer differs from the recording.
struct Difference {
  enum class Kind : std::uint8_t { kMissing, kUnexpected, kChanged, kEarly, kLate };
  Kind kind = Kind::kMissing;
  Instant at;              ///< Of the recorded frame; kUnexpected: of the answer.
  std::uint64_t line = 0;  ///< Of the recorded frame; kUnexpected: 0.
  std::string text;        ///< For people.
};

/// One value of a recorded PDO, and of the answer that was held against it.
struct ValuePair {
  std::uint8_t node = 0;
  Instant at;              ///< Of the recorded frame.
  std::uint64_t line = 0;  ///< Likewise.
  const decode::DecodedValue& recorded;
  const decode::DecodedValue& answered;
};

/// Compares what a party says now with what it said in the recording: order, times, content.
///
/// Every answer is held against the oldest recorded frame of the same identifier that has no answer yet, if the two are
/// not further apart than the tolerance of time. What finds no partner so is looked at again: up to five tolerances
/// apart an equal frame is early or late, and beyond that one is missing or another unexpected.
class Comparison {
 public:
  /// @param view  a fresh view of the rig; it follows what is compared.
  Comparison(decode::BusView& view, Tolerance tolerance) : view_{view}, tolerance_{std::move(tolerance)} {}

  /// Every value that is compared from here on goes to `watcher`, whether it differs or not.
  void watch(std::function<void(const ValuePair&)> watcher) { watcher_ = std::move(watcher); }
  /// The recording has a frame of the compared party here. In the order of the recording.
  void expect(const ScriptFrame& recorded);
  /// The party said this.
  void answer(Instant at, const can::CanFrame& frame);
  /// A frame of the other side, for the view.
  void hear(const can::CanFrame& frame) { view_.take(frame); }
  /// Recorded frames that are overdue at `now` are missing from here on.
  void expire(Instant now);
  /// When expire() has something to do next; never if nothing is expected.
  [[nodiscard]] Instant next_expiry() const;
  /// Whether a recorded frame still waits for its answer and is not overdue.
  [[nodiscard]] bool is_waiting() const { return !expected_.empty(); }
  /// What is left has no partner. Call once, at the end.
  void finish(Instant end);

  /// The first 20 that were found, in the order of time after finish(); count() says how many there were.
  [[nodiscard]] const std::vector<Difference>& differences() const { return differences_; }
  [[nodiscard]] std::uint64_t count() const { return count_; }
  [[nodiscard]] std::uint64_t compared() const { return compared_; }
  /// Largest shift in time of an answer within the tolerance.
  [[nodiscard]] Nanos worst_shift() const { return worst_shift_; }

 private:
  struct Spoken {
    Instant at;
    can::CanFrame frame;
    std::uint64_t line = 0;  ///< 0: an answer.
  };

  void match(const Spoken& recorded, const Spoken& answered);
  void tell_values(const Spoken& recorded, const Spoken& answered);
  void note(Difference::Kind kind, const Spoken& what, std::string text);
  [[nodiscard]] std::string compare(const can::CanFrame& recorded, const can::CanFrame& answered);
  [[nodiscard]] Nanos window() const { return 5 * tolerance_.time; }

  static constexpr std::size_t kKept = 20;
  decode::BusView& view_;
  Tolerance tolerance_;
  std::function<void(const ValuePair&)> watcher_;
  std::deque<Spoken> expected_;  ///< Recorded, not overdue.
  std::deque<Spoken> overdue_;   ///< Recorded, perhaps late.
  std::deque<Spoken> early_;     ///< Answers, perhaps early.
  std::vector<Difference> differences_;
  std::uint64_t count_ = 0;
  std::uint64_t compared_ = 0;
  Nanos worst_shift_{};
};

}  // namespace meltbench::replay
