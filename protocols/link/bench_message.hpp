#pragma once
/// The embedded bus's own language: what a program and the broker say to each other over one SEQPACKET socket.
///
/// One message is one datagram; both ends are the same build on the same machine, so numbers stand as they are in
/// memory.
///
///   program -> broker   Hello {name, signals}                      first; or, of who gives faults to a running bench,
///                       Question {about, text} -> Answer {accepted, text, hint}, one a connection
///   broker -> program   Welcome {pace, ...}                        when all that the run waits for are there
///   lockstep:           Wake {now, frames} -> Done {deadline, frames, events, signals}, in turn, until Stop
///   wall clock:         Frames and Serial {line, bytes} both ways at any time; program -> broker Report {at, signals,
///   events}; until Stop;
///                       program -> broker Timing {buckets} every second and last of all
///                       broker -> program Nodes and Lines {states} when one has changed, Order {text}

#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/can/frame.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::link {

inline constexpr std::uint32_t kBenchProtocolVersion = 2;
inline constexpr std::size_t kMaxMessageSize = 128 * 1024;

enum class MessageType : std::uint8_t {
  kHello = 1,
  kWelcome,
  kWake,
  kDone,
  kFrames,
  kReport,
  kStop,
  kTiming,
  kSerial,
  kNodes,
  kLines,
  kOrder,
  kQuestion,
  kAnswer,
};

/// How time passes in a run.
enum class Pace : std::uint8_t { kLockstep, kWallClock };

struct Welcome {
  Pace pace = Pace::kLockstep;
  double speed = 1.0;         ///< Wall clock: bench seconds per second.
  Nanos start_monotonic{};    ///< Wall clock: the CLOCK_MONOTONIC reading that is Instant{0}.
  Nanos record_period{10ms};  ///< A Report is wanted at every whole multiple.
};

/// Builds one message. Keeps its memory from message to message.
class MessageWriter {
 public:
  /// Room for messages of so many bytes, so that they do not allocate.
  void reserve(std::size_t size) { bytes_.reserve(size); }
  void begin(MessageType type) {
    bytes_.clear();
    put(type);
  }
  template <typename T>
  void put(const T& value) {
    static_assert(std::is_trivially_copyable_v<T>);
    put_bytes(&value, sizeof(T));
  }
  void put_text(std::string_view text);
  void put_frame(Instant at, const can::CanFrame& frame);
  void put_numbers(std::span<const double> numbers);
  [[nodiscard]] std::span<const std::uint8_t> bytes() const { return bytes_; }

 private:
  void put_bytes(const void* first, std::size_t size) {
    const std::size_t at = bytes_.size();
    bytes_.resize(at + size);
    if (size > 0) std::memcpy(bytes_.data() + at, first, size);
  }
  std::vector<std::uint8_t> bytes_;
};

/// Reads one message. Anything missing or impossible makes ok() false and yields zeros: check once, at the end.
class MessageReader {
 public:
  explicit MessageReader(std::span<const std::uint8_t> bytes) : rest_{bytes} {}

  template <typename T>
  [[nodiscard]] T take() {
    static_assert(std::is_trivially_copyable_v<T>);
    T value{};
    if (rest_.size() < sizeof(T)) {
      ok_ = false;
      rest_ = {};
      return value;
    }
    std::memcpy(&value, rest_.data(), sizeof(T));
    rest_ = rest_.subspan(sizeof(T));
    return value;
  }
  [[nodiscard]] std::string_view take_text();
  [[nodiscard]] can::StampedFrame take_frame();
  /// Fills all of `numbers`.
  void take_numbers(std::span<double> numbers);
  /// True while nothing was missing.
  [[nodiscard]] bool ok() const { return ok_; }
  /// True if all was read and nothing was missing.
  [[nodiscard]] bool complete() const { return ok_ && rest_.empty(); }

 private:
  std::span<const std::uint8_t> rest_;
  bool ok_ = true;
};

}  // namespace meltbench::link
