#pragma once
/// What happened on recorded serial lines, in words: pieces of Modbus RTU in, findings out.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/config/rig.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::decode {

enum class LineFindingKind : std::uint8_t {
  kPolls,     ///< A request, again and again.
  kRefused,   ///< An exception; equal ones in a row are one finding.
  kGarbled,   ///< Bytes that are no frame.
  kNoAnswer,  ///< Requests to one unit.
  kSilence,   ///< Nobody says anything: `at` is the last byte before, `until` the first piece after.
};

struct LineFinding {
  LineFindingKind kind{};
  Instant at;                      ///< When it began.
  std::optional<Instant> until{};  ///< Last of a row, or when it was over. None: not before the end of the log.
  std::uint64_t count = 1;
  std::string line;
  std::string text;  ///< Without the time of the beginning.
};

/// Listens to Modbus RTU. It need not know who speaks: a frame is the answer if it fits what was asked before.
/// Silence is a pause of more than 2.5 times the longest of the last five between requests, and 200 ms at the least.
///
/// Cost: some ns a byte, checksums twice. Memory: the findings, at most kMaxFindings.
class LineStory {
 public:
  static constexpr std::size_t kMaxFindings = 100'000;

  /// @param rig  names the units; outlives the story. Lines that it does not have are followed, too.
  explicit LineStory(const config::Rig& rig) : rig_{rig} {}

  /// A piece without a gap. @param at  when its last byte was there.
  void take(Instant at, std::string_view line, std::span<const std::uint8_t> bytes);
  /// Ends what is still open, and puts the findings into the order of time. To be called once.
  /// @param end  of the whole log; that of the last piece if that is later.
  void finish(Instant end);

  [[nodiscard]] const std::vector<LineFinding>& findings() const { return findings_; }  ///< After finish().
  [[nodiscard]] std::uint64_t left_out() const { return left_out_; }

 private:
  static constexpr std::size_t kNone = ~std::size_t{0};
  struct Unit {
    bool is_missed = false;         ///< Its newest answer.
    std::size_t no_answer = kNone;  ///< Findings that are open.
    std::size_t refused = kNone;
    unsigned refusal = 0;
  };
  struct Request {
    Instant at;
    std::uint8_t unit = 0;
    std::vector<std::uint8_t> pdu;
  };
  struct Line {
    std::string name;
    std::optional<Request> asked;  ///< Not answered yet.
    std::optional<Instant> last_piece;
    std::optional<Instant> last_request;
    std::array<Nanos, 5> pauses{};  ///< Between requests.
    std::size_t requests = 0;
    std::size_t garbled = kNone;
    std::map<std::string, std::size_t> polls;  ///< By what is asked of whom.
    std::map<std::uint8_t, Unit> units;
  };

  [[nodiscard]] Line& find_line(std::string_view name);
  [[nodiscard]] std::size_t take_frame(Line& line, Instant at, std::span<const std::uint8_t> bytes);
  void take_request(Line& line, Instant at, std::uint8_t unit, std::span<const std::uint8_t> pdu, bool is_foreign);
  void take_answer(Line& line, Instant at, std::span<const std::uint8_t> pdu);
  void take_garbled(Line& line, Instant at, std::size_t bytes);
  void miss_answer(Line& line, Instant at);
  void tell_silence(Line& line, std::optional<Instant> until, Instant now);
  std::size_t add(LineFinding finding);
  [[nodiscard]] bool goes_on(std::size_t row, Instant at) const;
  void repeat(std::size_t row, Instant at);
  [[nodiscard]] std::string name_of(const Line& line, std::uint8_t unit) const;
  static void word(LineFinding& finding, Instant end);

  const config::Rig& rig_;
  std::vector<Line> lines_;
  std::vector<LineFinding> findings_;
  std::uint64_t left_out_ = 0;
};

}  // namespace meltbench::decode
