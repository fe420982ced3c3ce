#pragma once
/// What a serial line's own recording says of the line: pieces that are no frames, requests that nobody answers.

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/config/rig.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::decode {

/// A stretch in which nothing came through a line as it was sent.
struct LineTrouble {
  enum class Kind : std::uint8_t {
    kGarbled,  ///< What came was no frame of Modbus RTU: its checksum is wrong.
    kSilent,   ///< Requests went out, and no byte came back.
  };
  Kind kind{};
  std::string line;
  Instant at;     ///< Before its first byte was sent.
  Instant until;  ///< Behind its last; before whatever came through again.
};

/// All of one line.
struct LineReport {
  std::string line;
  std::vector<LineTrouble> troubles;  ///< In the order of time, at most kMostTroubles.
  std::uint64_t garbled = 0;          ///< Pieces,
  std::uint64_t silent = 0;           ///< requests.
  std::uint64_t garbled_bytes = 0;    ///< Bytes of all pieces between the first and the last trouble,
  double byte_share = 0.0;            ///< and the share of them that must have been wrong to garble so many.
};

/// Listens to the serial lines of a rig. Requests are the controller's, all else are answers.
/// Cost: some ns a byte. Memory: what it finds.
class LineListener {
 public:
  static constexpr std::size_t kMostTroubles = 10'000;

  explicit LineListener(const config::Rig& rig);

  /// @param at    when the last byte was there.
  /// @param line  others than those of the rig are passed over.
  void take(Instant at, std::string_view line, std::string_view sender, const std::vector<std::uint8_t>& bytes);
  /// @returns one report for every line of the rig, in its order. To be called once.
  [[nodiscard]] std::vector<LineReport> finish();

 private:
  struct Line {
    LineReport report;
    serial::LineSettings settings;
    std::optional<LineTrouble> open;  ///< Silence that may go on.
    std::optional<Instant> asked_at;  ///< A request that was sent well and is not answered yet.
    std::uint64_t unanswered = 0;     ///< In a row.
    Instant unanswered_since{};
    bool was_well = true;                                 ///< The newest piece.
    std::uint64_t bytes_in_frames = 0;                    ///< Since the first trouble: to estimate the share,
    std::uint64_t frames = 0;                             ///< with so many frames,
    std::uint64_t bytes_at_last = 0, frames_at_last = 0;  ///< up to the last trouble.
  };

  void add(Line& line, LineTrouble::Kind kind, Instant at, Instant until);
  void end_silence(Line& line, Instant until);

  std::vector<Line> lines_;
};

}  // namespace meltbench::decode
