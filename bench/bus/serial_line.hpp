#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "protocols/serial/line_settings.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::bus {

/// What a fault does to the bytes of a line.
class LineFault {
 public:
  virtual ~LineFault() = default;
  /// A piece is about to be sent. Change, cut or clear `bytes` (none left: nothing is on the line).
  /// @returns how much later than normal it is sent; >= 0.
  [[nodiscard]] virtual Nanos strike(Instant now, std::size_t sender, std::vector<std::uint8_t>& bytes) = 0;
};

/// Bytes that came over a line without a gap.
struct LineDelivery {
  Instant at;              ///< When the last byte was there.
  std::size_t sender = 0;  ///< End that sent them: it does not hear itself.
  std::vector<std::uint8_t> bytes;
};

/// One serial line with two or more ends, as RS-485 with two wires has them: what one end sends all others hear.
///
/// n bytes written at t are there at t + n · bits per character / baud rate, later if the same end is still sending:
/// then they follow without a gap, as a piece of their own. Where two ends send at once, all hear garbage in both
/// pieces, for the bytes that overlap. An end can be unplugged: it neither hears nor is heard, and what it was sending
/// breaks off. Pure: time is an argument; equal calls give equal deliveries.
class SerialLine {
 public:
  explicit SerialLine(const serial::LineSettings& settings) : settings_{settings} {}

  /// @returns the number of a new end: 0, 1, ...
  std::size_t add_end();

  /// @param now  never before that of any earlier call.
  void write(Instant now, std::size_t sender, std::span<const std::uint8_t> bytes);

  /// When the next piece is there; Instant::never() if nothing is under way.
  [[nodiscard]] Instant next_delivery() const { return next_delivery_; }
  /// Takes the piece that is there first, of several the one of the lowest end. @pre next_delivery() is not never.
  /// The reference is good until the next call of take() or write().
  [[nodiscard]] const LineDelivery& take();

  void unplug(Instant now, std::size_t end);
  void plug(std::size_t end) { plugged_[end] = true; }
  [[nodiscard]] bool is_plugged(std::size_t end) const { return plugged_[end]; }

  /// @param fault  strikes every piece that is written from now on; null: none. Outlives the line or is taken away.
  void set_fault(LineFault* fault) { fault_ = fault; }

 private:
  struct Piece {
    LineDelivery delivery;
    Instant begin;
    std::size_t garbled_from = 0;  ///< These bytes overlap with another end's: from <= i < to.
    std::size_t garbled_to = 0;
  };
  void collide(Piece& piece, const Piece& other) const;
  void find_next();

  serial::LineSettings settings_;
  LineFault* fault_ = nullptr;
  std::vector<bool> plugged_;
  std::vector<Instant> busy_until_;  ///< Of each end.
  std::vector<Piece> under_way_;
  std::size_t next_ = 0;  ///< In under_way_.
  Instant next_delivery_ = Instant::never();
  LineDelivery taken_;
  std::vector<std::vector<std::uint8_t>> spare_;  ///< Memory for later pieces.
};

}  // namespace meltbench::bus
