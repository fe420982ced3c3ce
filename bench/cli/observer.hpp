#pragma once

#include <deque>
#include <string>
#include <string_view>
#include <vector>

#include "bench/bus/run_observer.hpp"
#include "bench/cli/progress.hpp"
#include "bench/decode/wire_signals.hpp"
#include "bench/record/run_recorder.hpp"

namespace meltbench::cli {

/// Hands what happens in a run to its recorder, and the time to the progress line.
class Observer final : public bus::RunObserver {
 public:
  /// @param recorder, wire, progress  outlive this object. @param wire  null: its signals are not recorded.
  Observer(record::RunRecorder& recorder, decode::WireSignals* wire, Progress& progress);

  void on_frame(const can::StampedFrame& frame, std::size_t sender) override;
  void on_serial(std::string_view line, std::size_t sender, Instant at, std::span<const std::uint8_t> bytes) override;
  void on_row(Instant at, std::span<const double> values) override;
  void on_event(std::size_t participant, const Event& event) override;
  void on_join(std::string_view name) override;

 private:
  [[nodiscard]] std::string_view name_of(std::size_t participant) const;
  [[nodiscard]] std::span<const double> append_wire(Instant at, std::span<const double> values);

  record::RunRecorder& recorder_;
  std::vector<std::string> names_;  ///< Of the participants, by number.
  decode::WireSignals* wire_;
  std::deque<can::StampedFrame> not_in_a_row_;
  std::vector<double> row_;
  Progress& progress_;
  std::uint64_t rows_ = 0;
  Instant next_flush_;  ///< never: the recorder's own blocks do, in virtual time a second is nothing.
};

}  // namespace meltbench::cli
