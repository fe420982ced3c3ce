#pragma once
/// What the bus tells whoever records a run, and how a run can end.

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "protocols/can/frame.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::bus {

/// Sender number of a frame that no participant of the run has sent.
inline constexpr std::size_t kOutsideSender = 0xFF;
/// Sender number of a frame that a program outside the run has put on the embedded bus.
inline constexpr std::size_t kTapSender = 0xFE;

/// Sees everything that happens, in the order in which it happens.
class RunObserver {
 public:
  virtual ~RunObserver() = default;
  /// A frame was on the bus. @param sender  number of the participant, kTapSender or kOutsideSender.
  virtual void on_frame(const can::StampedFrame& frame, std::size_t sender) = 0;
  /// Bytes came over a serial line without a gap: which line, who sent them, when the last of them was there.
  virtual void on_serial(std::string_view, std::size_t, Instant, std::span<const std::uint8_t>) {}
  /// The signals of all participants at a whole multiple of the record period, in the order of the participants.
  virtual void on_row(Instant at, std::span<const double> values) = 0;
  virtual void on_event(std::size_t participant, const Event& event) = 0;
  /// A program that the bench did not start has joined a running bus; on_event() calls it by the next free number, its
  /// frames come from kTapSender, and its signals are not recorded.
  virtual void on_join(std::string_view /*name*/) {}
};

struct RunOutcome {
  enum class Kind : std::uint8_t { kCompleted, kInterrupted, kParticipantLost };
  Kind kind = Kind::kCompleted;
  std::string text;               ///< Not completed: who and why, for people.
  Instant at;                     ///< How far the run came.
  std::uint64_t lost_frames = 0;  ///< Frames that a participant was too slow to take (wall clock only).
};

}  // namespace meltbench::bus
