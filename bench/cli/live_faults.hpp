#pragma once

#include <chrono>

#include "bench/bus/broker.hpp"
#include "bench/bus/run_observer.hpp"
#include "bench/cli/fault_limits.hpp"
#include "bench/fault/injector.hpp"

namespace meltbench::cli {

/// The faults of a run to which others may be given while it goes on: "meltbench fault".
///
/// A fault that comes in begins at the next instant of the run, and goes into repro.toml with it, so that repeating the
/// run repeats the fault. Whoever asks waits; the run never does: it looks every few milliseconds of wall-clock time.
class LiveFaults final : public bus::Intervention {
 public:
  /// @param injector, broker, prepared, observer  of the run; outlive this object. What comes in is added to
  /// prepared.run, and is an event of the bench.
  LiveFaults(fault::Injector& injector, bus::Broker& broker, PreparedRun& prepared, FaultLimits limits,
             bus::RunObserver& observer);

  bool look(Instant now) override;
  [[nodiscard]] Instant next_deadline() const override { return injector_.next_deadline(); }
  void on_time(Instant now, bus::RunControl& run) override { injector_.on_time(now, run); }
  [[nodiscard]] bool on_frame(const can::StampedFrame& frame, std::size_t sender, bus::RunControl& run) override {
    return injector_.on_frame(frame, sender, run);
  }
  void on_row(Instant at, std::span<const double> values) override { injector_.on_row(at, values); }

 private:
  [[nodiscard]] runtime::Answer reply(const runtime::Question& question, Instant now);
  [[nodiscard]] std::string begin(const std::string& text, Instant now);
  [[nodiscard]] runtime::Answer clear(const std::string& name, Instant now);
  [[nodiscard]] std::string list(Instant now) const;
  void keep(Instant now, std::string_view code, const std::string& text);

  fault::Injector& injector_;
  bus::Broker& broker_;
  PreparedRun& prepared_;
  FaultLimits limits_;
  fault::Scope scope_;
  bus::RunObserver& observer_;
  std::chrono::steady_clock::time_point next_look_;
};

}  // namespace meltbench::cli
