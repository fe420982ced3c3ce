/// What a cycle of the coupled extruder costs, and who spends it: controller and emulated machine apart.

#include <benchmark/benchmark.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <string>

#include "bench/bus/virtual_time.hpp"
#include "bench/cli/list_command.hpp"
#include "bench/cli/prepare_run.hpp"

namespace {

using namespace meltbench;

/// In-process port with a stopwatch: the participant's own time, without bus and recording.
class TimedPort final : public runtime::ParticipantPort {
 public:
  explicit TimedPort(Participant& participant) : port_{participant} {}
  [[nodiscard]] std::string_view name() const override { return port_.name(); }
  [[nodiscard]] std::span<const SignalInfo> signals() const override { return port_.signals(); }
  [[nodiscard]] std::span<const std::string> nodes() const override { return port_.nodes(); }
  [[nodiscard]] std::span<const std::string> lines() const override { return port_.lines(); }
  [[nodiscard]] runtime::PortStatus wake(const Wakeup& in, Outbox& out, std::span<double> signals) override {
    const auto from = std::chrono::steady_clock::now();
    const runtime::PortStatus status = port_.wake(in, out, signals);
    spent_ += std::chrono::steady_clock::now() - from;
    return status;
  }
  [[nodiscard]] double spent_us() const { return std::chrono::duration<double, std::micro>(spent_).count(); }

 private:
  runtime::InProcessPort port_;
  std::chrono::steady_clock::duration spent_{};
};

class NoObserver final : public bus::RunObserver {
 public:
  void on_frame(const can::StampedFrame&, std::size_t) override {}
  void on_row(Instant, std::span<const double>) override {}
  void on_event(std::size_t, const Event&) override {}
};

/// Microseconds per SYNC of 10 ms; a speed change is in the run.
void coupled_cycle(benchmark::State& state) {
  double controller_us = 0.0, plant_us = 0.0, cycles = 0.0;
  for (auto _ : state) {
    static_cast<void>(_);
    auto runs = scenario::load(cli::find_scenarios() / "coupled_speed_change.toml");
    cli::PreparedRun prepared = cli::prepare(std::move(runs.front()), std::filesystem::temp_directory_path(), {});
    TimedPort controller{*prepared.controller};
    TimedPort plant{*prepared.plant};
    const std::array<runtime::ParticipantPort*, 2> ports{&controller, &plant};
    NoObserver observer;
    const auto outcome = bus::VirtualTime{ports, prepared.run.record_period, observer}.run(prepared.run.duration);
    if (outcome.kind != bus::RunOutcome::Kind::kCompleted) state.SkipWithError(outcome.text.c_str());
    controller_us += controller.spent_us();
    plant_us += plant.spent_us();
    cycles += to_s(prepared.run.duration) / 10e-3;
  }
  state.counters["controller_us"] = controller_us / cycles;
  state.counters["plant_us"] = plant_us / cycles;
}
BENCHMARK(coupled_cycle)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
