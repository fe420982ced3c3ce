#pragma once
/// Finds frames in the bytes of a line, by their length where the function code tells it, else by silence.

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>

#include "protocols/modbus/types.hpp"

namespace meltbench::modbus {

/// Who talks: a function code has other lengths in a request than in an answer.
enum class Direction : std::uint8_t { kRequests, kAnswers };

/// Length of the frame that begins with these bytes, checksum included.
/// @returns nothing while too little of it is there, or if its function code is none of ours.
[[nodiscard]] std::optional<std::size_t> find_length(Direction direction, std::span<const std::uint8_t> begin);

/// A frame without its checksum. The bytes live until the reader is given more.
struct Frame {
  std::uint8_t unit = 0;
  std::span<const std::uint8_t> pdu;  ///< Function code and data: 1..kMaxPdu bytes.
  Instant at;                         ///< When its end was known.
};

/// Bytes in, frames out. A frame whose checksum is wrong, or that breaks off, is counted and lost with all that follows
/// it without a gap of t3_5. Real time: no allocation, about 3 ns a byte.
class FrameReader {
 public:
  FrameReader(Direction direction, const LineTiming& timing) : direction_{direction}, timing_{timing} {}

  /// Takes bytes until a frame is complete: then take_frame() has it, and the rest is to be handed in again.
  /// @param at  when the last one of `bytes` was there; they came without a gap.
  /// @returns how many were taken, all of them if no frame is complete.
  [[nodiscard]] std::size_t take(Instant at, std::span<const std::uint8_t> bytes);

  /// The silence up to `now` may have ended a frame.
  void on_time(Instant now);

  [[nodiscard]] std::optional<Frame> take_frame();

  /// When silence would end a frame; never() if none is under way whose end is not in its length.
  [[nodiscard]] Instant next_deadline() const;

  /// Forgets what is under way.
  void reset() { size_ = 0, garbled_ = false; }

  [[nodiscard]] std::uint64_t frames_lost() const { return frames_lost_; }

 private:
  void end_by_silence(Instant at);
  void complete(Instant at);
  void garble();

  Direction direction_;
  LineTiming timing_;
  std::array<std::uint8_t, kMaxFrame> bytes_{};
  std::size_t size_ = 0;
  bool garbled_ = false;  // Nothing counts until the line is silent.
  std::optional<Instant> last_byte_at_;
  std::optional<Frame> frame_;
  std::uint64_t frames_lost_ = 0;
};

}  // namespace meltbench::modbus
