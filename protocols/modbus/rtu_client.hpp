#pragma once
/// The master's side of a line: one request at a time, with time-out and repetition.

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "protocols/modbus/frame_reader.hpp"
#include "protocols/modbus/pdu.hpp"

namespace meltbench::modbus {

/// How patient a client is.
struct ClientTimes {
  Nanos answer_timeout = 100ms;        ///< From the end of the request on the wire to the end of the answer.
  unsigned retries = 2;                ///< So many times a request that was not answered is sent again.
  Nanos broadcast_turnaround = 100ms;  ///< Silence after a broadcast, for the devices to do it.
};

/// How a request ended. `answer` lives until the client is given more.
struct ClientResult {
  enum class Outcome : std::uint8_t { kAnswer, kException, kTimeout, kBroadcastDone };
  Outcome outcome = Outcome::kTimeout;
  ExceptionCode exception = ExceptionCode::kNone;
  std::span<const std::uint8_t> answer;  ///< PDU; also of an exception.
  Instant request_end;                   ///< The last byte of the (last) request was on the wire: the device read it.
  Instant at;                            ///< The answer was there, or was given up.
  unsigned attempts = 1;
};

/// Owns the line: nobody else may send on it. Requests are kept apart by t3_5.
///
/// An answer counts if unit, function and counts (or echo) fit the request under way. Anything else is dropped and
/// counted: late answers to requests given up, noise, another master's talk. RTU has no transaction numbers, so a late
/// answer of the same shape is not told from the right one: the time-out must be longer than the device ever takes.
/// Real time: no allocation, but for what the caller's byte queue needs.
class RtuClient {
 public:
  RtuClient(const LineTiming& timing, const ClientTimes& times)
      : timing_{timing}, times_{times}, reader_{Direction::kAnswers, timing} {}

  [[nodiscard]] bool is_idle() const { return phase_ == Phase::kIdle; }

  /// Begins a request; it may leave a little later, in on_time(). @pre is_idle().
  void send(Instant now, std::uint8_t unit, const Pdu& request, std::vector<std::uint8_t>& out);
  /// Gives up the request under way, without a result.
  void cancel() { phase_ = Phase::kIdle; }

  void on_bytes(Instant at, std::span<const std::uint8_t> bytes);
  /// Time-outs, repetitions, requests that waited for silence.
  void on_time(Instant now, std::vector<std::uint8_t>& out);
  [[nodiscard]] Instant next_deadline() const;

  /// The end of the request, once; the client is idle then.
  [[nodiscard]] std::optional<ClientResult> take_result();

  [[nodiscard]] std::uint64_t timeouts() const { return timeouts_; }  ///< Each repetition counts.
  [[nodiscard]] std::uint64_t rejected() const { return rejected_; }  ///< Whole frames that were no answer.
  [[nodiscard]] std::uint64_t frames_lost() const { return reader_.frames_lost(); }

 private:
  enum class Phase : std::uint8_t {
    kIdle,
    kHeld,     ///< For the line to be silent.
    kWaiting,  ///< For the answer, or the end of the turnaround.
    kDone,     ///< The result waits to be taken.
  };
  void transmit(Instant now, std::vector<std::uint8_t>& out);
  void handle(Instant at, const Frame& frame);
  void conclude(ClientResult::Outcome outcome, Instant at);

  LineTiming timing_;
  ClientTimes times_;
  FrameReader reader_;
  Phase phase_ = Phase::kIdle;
  std::uint8_t unit_ = 0;
  Pdu request_;
  Pdu answer_;
  unsigned attempts_ = 0;
  Instant quiet_at_{};  // From then on the line may be used.
  Instant request_end_;
  Instant give_up_at_;
  ClientResult result_;
  std::uint64_t timeouts_ = 0;
  std::uint64_t rejected_ = 0;
};

}  // namespace meltbench::modbus
