#pragma once

#include <string>
#include <vector>

#include "bench/replay/comparison.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::replay {

/// Which side of a recording is replaced by a live party; the other side is played from the log.
enum class LiveSide : std::uint8_t { kController, kBoards };

/// Plays one side of a recording to a live party of the other, and compares what that says.
///
/// A recorded frame is sent at its time, but not before the live party has said what it said before it in the
/// recording, or is overdue with it: so an answer never comes before its question.
class LogPartner final : public Participant {
 public:
  /// @param script, comparison  outlive this object.
  LogPartner(const Script& script, LiveSide live, Comparison& comparison);

  [[nodiscard]] std::string_view name() const override { return "log"; }
  void wake(const Wakeup& in, Outbox& out) override;
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return {}; }
  void read_signals(std::span<double>) const override {}

 private:
  [[nodiscard]] bool is_played(const ScriptFrame& frame) const {
    return frame.from_controller == (live_ == LiveSide::kBoards);
  }

  const Script& script_;
  LiveSide live_;
  Comparison& comparison_;
  std::size_t next_ = 0;  ///< Frame of the script.
};

}  // namespace meltbench::replay
