#pragma once
/// What happened on a recorded bus, in words: frames in, findings out.

#include <array>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "bench/decode/bus_view.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::decode {

enum class FindingKind : std::uint8_t {
  kBoot,           ///< A boot-up message. `code` 1: nobody had asked for it.
  kNmt,            ///< A command of the master; equal ones in a row are one. `code`: command * 256 + node.
  kState,          ///< A heartbeat shows another NMT state.
  kHeartbeatLost,  ///< `at` is the last one before, `until` the next. `code` 1: nothing else came of the node either.
  kEmcy,           ///< `code`; equal ones in a row are one finding.
  kSdo,            ///< A group of dialogues with one node.
  kSdoFailed,      ///< Aborted, or no answer.
  kSetPoint,       ///< A value that the controller sends changes: `before`, `after`; changes in a row are one finding.
                   ///< `code` 1: up to its last change it had changed in every frame.
  kInvalid,      ///< A board says that a measurement is not valid, until it is again. `code` is the status of CiA 404.
  kGap,          ///< A regular frame stays away: `at` is the last one before, `until` the next.
  kTooOften,     ///< A regular frame comes again much too early: two senders? `before`: the period [s].
  kErrorFrames,  ///< Of one class. `code` bit 0: a dominant bit came back as recessive; bit 1: frames came through
                 ///< between. `before`, `after`: for how long none had come before it, and none came after it [s].
  kErrorState,   ///< As the recording node saw it. `code` 1: bus-off, 2: restarted, 3: error-passive.
  kUnknown,      ///< Frames of an identifier that nobody of the rig uses.
  kMessage,      ///< Such frames, if the DBC names them.
};

struct Finding {
  FindingKind kind{};
  Instant at;                      ///< When it began.
  std::optional<Instant> until{};  ///< Last of a row, or when it was over. None: not before the end of the log.
  std::uint64_t count = 1;
  std::uint8_t node = 0;
  std::uint32_t id = 0;
  std::uint16_t code = 0;
  canopen::ObjectAddress address{};  ///< kSetPoint, kInvalid, kSdoFailed.
  double before = 0.0;
  double after = 0.0;
  std::string text;  ///< Without the time of the beginning.
};

/// How much the wire was in use.
struct Load {
  std::vector<float> per_second;  ///< Share 0..1 of every second, stuff bits and pauses between frames counted; the
                                  ///< last one only if the log has half of it.
  double mean = 0.0;              ///< Over the time of the log.
};

/// Listens to a bus and tells what a person would want to know of it. Nothing is known beforehand but the rig's boards:
/// periods are learned from the frames, as the median of the last five gaps, and 2.5 periods without a frame are a gap.
/// A synchronous frame is not missed while SYNC is missing, nor a node's frames while the whole node is silent.
///
/// Cost: about 0.3 us a frame. Memory: the findings (at most kMaxFindings) and 4 bytes for each second.
class Story {
 public:
  static constexpr std::size_t kMaxFindings = 100'000;

  /// @param dbc  as for BusView.
  /// @throws canopen::EdsError, config::ConfigError if an EDS cannot be read.
  explicit Story(const config::Rig& rig, const Dbc* dbc = nullptr);

  /// @param at  since the log's beginning; not before that of the frame before: time that goes back stands still.
  void take(Instant at, const can::CanFrame& frame);
  /// Ends what is still open, and puts the findings into the order of time. To be called once.
  void finish();

  [[nodiscard]] const std::vector<Finding>& findings() const { return findings_; }  ///< After finish().
  [[nodiscard]] std::uint64_t left_out() const { return left_out_; }                ///< Findings beyond kMaxFindings.
  [[nodiscard]] const Load& load() const { return load_; }                          ///< After finish().
  [[nodiscard]] std::uint64_t frames() const { return frames_; }                    ///< Error frames among them.
  [[nodiscard]] Instant end() const { return now_; }
  [[nodiscard]] BusView& view() { return view_; }

 private:
  static constexpr std::size_t kNone = ~std::size_t{0};
  static constexpr Nanos kLongAgo{86'400'000'000'000};
  struct Cycle {  ///< Of an identifier.
    Instant last;
    std::array<std::int64_t, 5> gaps_ns{};
    std::uint64_t seen = 0;
    std::uint8_t node = 0;
    std::size_t early = kNone;   ///< Finding that is open.
    Instant back_at{-kLongAgo};  ///< End of the last gap.
  };
  struct Talk {  ///< SDO with one node.
    std::size_t group = kNone;
    std::optional<can::CanFrame> request;  ///< Not answered yet,
    Instant asked_at;                      ///< since then.
  };
  struct Value {
    unsigned in_a_row = 0;  ///< Frames, each with another value.
    double last = 0.0;
    std::size_t finding = kNone;
  };
  struct Node {
    std::uint8_t state = 0xFF;
    Instant reset_asked{-kLongAgo};
    std::size_t emcy = kNone;
    Talk talk;
  };

  Finding* add(Finding finding);
  Finding* open(std::size_t& place, Finding finding);
  void on_nmt(const can::CanFrame& frame);
  void on_heartbeat(const FrameMeaning& meaning, const can::CanFrame& frame);
  void on_emcy(const FrameMeaning& meaning, const can::CanFrame& frame);
  void on_sdo(const FrameMeaning& meaning, const can::CanFrame& frame);
  void on_set_points(const FrameMeaning& meaning, const can::CanFrame& frame);
  void on_measurements(const FrameMeaning& meaning, const can::CanFrame& frame);
  void on_error(const can::CanFrame& frame);
  void on_unknown(const can::CanFrame& frame);
  void follow_cycle(const FrameMeaning& meaning, std::uint32_t id);
  void take_early(Cycle& cycle, const FrameMeaning& meaning, std::uint32_t id, Nanos period);
  bool tell_gap(Cycle& cycle, std::uint32_t id, std::optional<Instant> until);
  void forget_cycles(std::uint8_t node, bool with_heartbeat);
  void fail_request(std::uint8_t node, Talk& talk, const std::string& why);
  void add_load(const can::CanFrame& frame);
  void absorb_gaps();
  void word(Finding& finding) const;

  BusView view_;
  Nanos bit_time_;
  Nanos data_bit_time_;
  std::uint8_t controller_id_;
  std::vector<std::uint8_t> known_nodes_;
  Instant now_{};
  std::uint64_t frames_ = 0;
  std::uint64_t left_out_ = 0;
  std::vector<Finding> findings_;
  Finding spare_;  ///< Takes what is beyond kMaxFindings.
  std::array<Node, 128> nodes_{};
  std::map<std::uint32_t, Cycle> cycles_;
  std::map<std::uint64_t, Value> values_;  ///< By identifier, index and sub.
  std::map<std::uint32_t, std::size_t> unknown_;
  std::map<std::uint32_t, std::size_t> errors_;                    ///< By class.
  std::array<std::size_t, 4> states_{kNone, kNone, kNone, kNone};  ///< By code.
  std::size_t nmt_ = kNone;
  std::size_t error_row_ = kNone;  ///< Of the newest frame that was destroyed,
  bool came_through_ = true;       ///< and whether one came through since.
  Instant last_frame_{};
  std::vector<std::int64_t> busy_ns_;
  Load load_;
};

}  // namespace meltbench::decode
