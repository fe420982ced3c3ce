#pragma once
/// What a participant's process and the broker tell each other, in terms of participants; bytes in
/// link/bench_message.hpp.

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/link/bench_message.hpp"
#include "protocols/participant/participant.hpp"
#include "protocols/time/log_histogram.hpp"

namespace meltbench::runtime {

/// First message of a program that joins.
struct Hello {
  std::string name;
  bool carries_frames = true;  ///< False: its frames go over a kernel bus, this connection only reports.
  std::vector<SignalInfo> signals;
  std::vector<std::string> nodes;  ///< As Participant::nodes().
  std::vector<std::string> lines;  ///< As Participant::lines().
};
void write_hello(link::MessageWriter& writer, const Hello& hello);
[[nodiscard]] std::optional<Hello> read_hello(std::span<const std::uint8_t> message);

void write_welcome(link::MessageWriter& writer, const link::Welcome& welcome);
[[nodiscard]] std::optional<link::Welcome> read_welcome(std::span<const std::uint8_t> message);

/// Type of a message; nothing for an empty one.
[[nodiscard]] std::optional<link::MessageType> message_type(std::span<const std::uint8_t> message);

/// Lockstep: broker wakes a program.
void write_wake(link::MessageWriter& writer, const Wakeup& in);

/// What a Wakeup that came as a message points into. Kept from message to message, for its memory.
struct WakeupStorage {
  std::vector<can::StampedFrame> frames;
  std::vector<SerialArrival> serial;  ///< Their bytes lie in the message.
  std::vector<LinkState> lines;
  std::vector<can::ErrorState> nodes;
  std::vector<std::string> orders;
};
/// @param storage  filled anew; the Wakeup points into it and into the message.
[[nodiscard]] std::optional<Wakeup> read_wake(std::span<const std::uint8_t> message, WakeupStorage& storage);

/// Lockstep: a program's answer.
void write_done(link::MessageWriter& writer, const Outbox& out, std::span<const double> signals);
/// @param out  filled anew.  @param signals  all of it is filled.  @returns false on nonsense.
[[nodiscard]] bool read_done(std::span<const std::uint8_t> message, Outbox& out, std::span<double> signals);

/// Wall clock: what a program wants recorded, at one instant.
void write_report(link::MessageWriter& writer, Instant at, std::span<const Event> events,
                  std::span<const double> signals);
/// @returns the instant, or nothing on nonsense.
[[nodiscard]] std::optional<Instant> read_report(std::span<const std::uint8_t> message, std::vector<Event>& events,
                                                 std::span<double> signals);

/// Wall clock: how late the program's wake-ups were, since its start.
void write_timing(link::MessageWriter& writer, const LogHistogram& lateness);
/// @returns false on nonsense; the histogram then is not to be used.
[[nodiscard]] bool read_timing(std::span<const std::uint8_t> message, LogHistogram& lateness);

/// A frame on the embedded bus at wall-clock pace.
struct CarriedFrame {
  Nanos at_monotonic{};   ///< CLOCK_MONOTONIC: to the bench, of its sending; to a program, of its end on the wire.
  std::uint8_t node = 0;  ///< To the bench: which of the program's nodes() sends it.
  can::CanFrame frame;
};
void write_frame(link::MessageWriter& writer, const CarriedFrame& carried);
[[nodiscard]] std::optional<CarriedFrame> read_frame(std::span<const std::uint8_t> message);

/// Wall clock, to a program on a bit-timed bus: the states of its nodes have changed.
void write_node_states(link::MessageWriter& writer, std::span<const can::ErrorState> states);
/// @returns false if it is no such message.
[[nodiscard]] bool read_node_states(std::span<const std::uint8_t> message, std::vector<can::ErrorState>& states);

/// Wall clock, to a program: the plugs of its serial lines, in the order of its lines(), have been pulled out or put
/// in.
void write_line_states(link::MessageWriter& writer, std::span<const LinkState> states);
/// @returns false if it is no such message.
[[nodiscard]] bool read_line_states(std::span<const std::uint8_t> message, std::vector<LinkState>& states);

/// Wall clock, to a program: what the bench asks of it, as Wakeup::orders.
void write_order(link::MessageWriter& writer, std::string_view text);
/// @returns nothing if it is no such message.
[[nodiscard]] std::optional<std::string> read_order(std::span<const std::uint8_t> message);

/// What somebody outside asks of a running bench.
struct Question {
  enum class About : std::uint8_t {
    kRun,         ///< Which run is it? The answer is its folder, and in a second line its name.
    kBeginFault,  ///< `text` is the fault.
    kClearFault,  ///< `text` is its name.
    kFaults,      ///< Which are on, and what can fail?
  };
  About about = About::kRun;
  std::string text{};
};
struct Answer {
  bool accepted = false;
  std::string text;    ///< What happens now, or why it does not: for people.
  std::string hint{};  ///< Not accepted: what can be done; may be empty.
};
void write_question(link::MessageWriter& writer, const Question& question);
/// @returns nothing if it is no such message, or that of another version.
[[nodiscard]] std::optional<Question> read_question(std::span<const std::uint8_t> message);
void write_answer(link::MessageWriter& writer, const Answer& answer);
[[nodiscard]] std::optional<Answer> read_answer(std::span<const std::uint8_t> message);

/// Wall clock: bytes on a serial line that the embedded bus carries. To the bench: `at` is when they were written; to a
/// program: when the last of them was there. Both on CLOCK_MONOTONIC.
void write_serial_piece(link::MessageWriter& writer, const SerialArrival& piece);
/// @returns a piece whose bytes lie in the message, or nothing on nonsense.
[[nodiscard]] std::optional<SerialArrival> read_serial_piece(std::span<const std::uint8_t> message);

}  // namespace meltbench::runtime
