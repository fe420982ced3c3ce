#pragma once
/// From the frames of a log to the page about it.

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bench/decode/line_story.hpp"
#include "bench/decode/story.hpp"
#include "bench/record/bus_statistics.hpp"
#include "bench/report/log_page.hpp"
#include "bench/report/thinned_signals.hpp"

namespace meltbench::cli {

/// Takes a log frame by frame; its memory has bounds, however long the log is.
class LogPageMaker {
 public:
  /// @throws as decode::Story.
  explicit LogPageMaker(const config::Rig& rig, const decode::Dbc* dbc = nullptr);

  void take(Instant at, const can::CanFrame& frame);
  /// What serial lines tell; before finish().
  void add(const decode::LineStory& lines);
  /// When the last frame came.
  [[nodiscard]] Instant end() const { return story_.end(); }
  /// Last of all. Title, facts about the file and version are the caller's.
  [[nodiscard]] report::LogPage finish();

 private:
  /// Of a PDO: plotted as a line. Objects of one index and board share a plot.
  struct Line {
    std::uint8_t node = 0;
    canopen::ObjectAddress address;
    std::string name;
    std::optional<std::size_t> signal;  ///< In signals_; nothing if there was no room.
  };
  struct DbcLine {  ///< A signal of a message of the DBC.
    std::string title;
    std::string unit;
    std::optional<std::size_t> signal;  ///< As in Line.
  };
  struct Transfer {
    Instant at;
    std::uint8_t node = 0;
    std::string text;
  };

  void take_values(const decode::FrameMeaning& meaning, Instant at, const can::CanFrame& frame);
  void take_message(const decode::DbcMessage& message, Instant at, const can::CanFrame& frame);
  void take_transfer(const decode::FrameMeaning& meaning, Instant at, const can::CanFrame& frame);
  [[nodiscard]] std::vector<report::StoryLine> make_lines();
  [[nodiscard]] std::vector<std::string> find_transfers(const decode::Finding& dialogue) const;
  void break_lines();
  [[nodiscard]] report::Plots make_plots();
  void add_message_plots(report::Plots& plots) const;

  const config::Rig& rig_;
  decode::Story story_;
  record::BusCounter counter_;
  report::ThinnedSignals signals_;
  std::map<std::pair<std::uint32_t, std::uint32_t>, Line> lines_;  ///< By node, and index and sub.
  std::map<std::pair<std::uint64_t, const decode::DbcSignal*>, DbcLine> message_lines_;  ///< By message; file's order.
  std::vector<Transfer> transfers_;                                                      ///< The first of the log.
  std::uint64_t signals_left_out_ = 0;
  std::vector<report::StoryLine> of_serial_lines_;
  std::uint64_t left_out_ = 0;
};

}  // namespace meltbench::cli
