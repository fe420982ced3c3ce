#pragma once
/// Writes down what goes over serial lines.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "bench/record/log_files.hpp"
#include "bench/record/wire_recorder.hpp"
#include "protocols/link/serial_link.hpp"
#include "protocols/serial/line_settings.hpp"

namespace meltbench::record {

/// Sender in serial.log where nobody knows who has spoken.
inline constexpr std::string_view kUnknownSpeaker = "wire";

/// Appends "(0000000012.340000) LINE SENDER 0103000000C5DA\n". @param at  when the last byte was there; >= 0.
void append_serial_line(std::string& text, Instant at, std::string_view line, std::string_view sender,
                        std::span<const std::uint8_t> bytes);

/// A line to listen to. The link outlives the recorder.
struct HeardLine {
  std::string name;
  link::SerialLink* link = nullptr;
  serial::LineSettings settings;
};

struct LineRecorderResult {
  std::uint64_t pieces = 0;
  std::uint64_t bytes = 0;
  std::uint64_t downs = 0;  ///< Times that a port went away.
};

/// Text as a run's serial.log has it, one piece a line: bytes that follow each other without the silence that ends a
/// frame of Modbus RTU, 3.5 characters and at least 1.75 ms. A piece that goes on is cut at kMaxPiece bytes. A port
/// that goes away becomes a comment, and is looked for every 100 ms.
class LineRecorder final : public WireRecorder {
 public:
  static constexpr std::size_t kMaxPiece = 512;

  /// @param epoch_offset  as BusRecorderRequest has it.
  LineRecorder(std::vector<HeardLine> lines, LogFiles& files, Nanos epoch_offset);

  void watch(std::vector<pollfd>& watched) const override;
  void take() override;
  void flush() override { files_.flush(); }
  void finish(Nanos stopped_at) override;
  [[nodiscard]] const LineRecorderResult& result() const { return result_; }

 private:
  struct Line {
    HeardLine heard;
    Nanos silence{};
    std::vector<std::uint8_t> piece{};  ///< Not ended yet,
    Nanos last_byte_at{};               ///< so far, on CLOCK_MONOTONIC.
    bool is_up = true;
    Nanos next_look{};
  };
  struct Ended {
    Nanos at{};
    std::size_t line = 0;
    std::vector<std::uint8_t> bytes;
  };

  void take_bytes(std::size_t number, Nanos now);
  void add(std::size_t number, const link::ReceivedBytes& received);
  void end_piece(std::size_t number);
  void note_link(Line& line, bool is_up, Nanos now);
  void write_before(Nanos horizon);

  std::vector<Line> lines_;
  LogFiles& files_;
  Nanos epoch_offset_;
  Nanos longest_silence_{};
  std::vector<Ended> ended_;  ///< A piece of another line that is yet to end may come first.
  LineRecorderResult result_;
  Instant at_{};
  std::string text_;
};

}  // namespace meltbench::record
