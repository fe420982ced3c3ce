#include "plant_emulator/emulator.hpp"

#include <algorithm>
#include <array>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "plant_emulator/board/feeder.hpp"
#include "plant_emulator/board/melt_pressure.hpp"
#include "plant_emulator/board/screw_drive.hpp"

namespace meltbench::emulator {

namespace {

struct PlantSignal {
  std::string_view name;
  SignalKind kind;
};

// In the order of read_signals().
constexpr std::array kPlantSignals{
    PlantSignal{"plant.x_m", SignalKind::kValue},
    PlantSignal{"plant.U", SignalKind::kValue},
    PlantSignal{"plant.delay_s", SignalKind::kValue},
    PlantSignal{"plant.delay_rate", SignalKind::kValue},
    PlantSignal{"plant.flow_kg_per_s", SignalKind::kValue},
    PlantSignal{"plant.pressure_Pa", SignalKind::kValue},
    PlantSignal{"plant.speed_m_per_s", SignalKind::kValue},
    PlantSignal{"plant.conveyed_m", SignalKind::kValue},
    PlantSignal{"plant.feed_kg_per_s", SignalKind::kValue},
    PlantSignal{"plant.spill_m", SignalKind::kValue},
    PlantSignal{"plant.mass_residual_m", SignalKind::kValue},
    PlantSignal{"plant.rejected_feed_kg", SignalKind::kErrorCounter},
};

std::unique_ptr<board::Board> make_board(const BoardSettings& settings, std::uint64_t seed, board::Process& process) {
  const auto make = [&]<class Firmware>(const Firmware& firmware) -> std::unique_ptr<board::Board> {
    board::Chance chance{seed, settings.name};
    const auto build = [&]<class Kind>(std::type_identity<Kind>) {
      return std::make_unique<Kind>(settings.name, *settings.dictionary, settings.node_id, firmware, chance, process);
    };
    if constexpr (std::is_same_v<Firmware, board::FeederSettings>) {
      return build(std::type_identity<board::Feeder>{});
    } else if constexpr (std::is_same_v<Firmware, board::ScrewDriveSettings>) {
      return build(std::type_identity<board::ScrewDrive>{});
    } else {
      return build(std::type_identity<board::MeltPressure>{});
    }
  };
  return std::visit(make, settings.firmware);
}

}  // namespace

/// The model as the boards see it. Outputs are computed at most once per instant.
class Emulator::ExtruderProcess final : public board::Process {
 public:
  explicit ExtruderProcess(const plant::BizoneParameters& parameters) : extruder_{parameters} {}

  [[nodiscard]] double pressure_Pa() const override { return extruder_.pressure_Pa(); }
  [[nodiscard]] double encoder_rev() const override { return extruder_.encoder_m() / extruder_.parameters().pitch_m; }
  [[nodiscard]] double encoder_rev_per_s() const override {
    return outputs().encoder_m_per_s / extruder_.parameters().pitch_m;
  }
  void set_feed_kg_per_s(double feed_kg_per_s) override {
    extruder_.set_feed_kg_per_s(feed_kg_per_s);
    outputs_.reset();
  }
  void set_screw_rev_per_s(double screw_rev_per_s) override {
    extruder_.set_screw_rev_per_s(screw_rev_per_s);
    outputs_.reset();
  }

  void advance_to(Instant to) {
    if (to <= extruder_.now()) return;
    extruder_.advance_to(to);
    outputs_.reset();
  }

  [[nodiscard]] const plant::BizoneOutputs& outputs() const {
    if (!outputs_) outputs_ = extruder_.outputs();
    return *outputs_;
  }
  [[nodiscard]] const plant::BizoneExtruder& extruder() const { return extruder_; }

 private:
  plant::BizoneExtruder extruder_;
  mutable std::optional<plant::BizoneOutputs> outputs_;
};

Emulator::Emulator(const EmulatorSettings& settings, std::uint64_t seed)
    : process_{std::make_unique<ExtruderProcess>(settings.plant)} {
  for (const PlantSignal& signal : kPlantSignals) signals_.push_back({std::string{signal.name}, signal.kind});
  for (const BoardSettings& board : settings.boards) {
    boards_.push_back(make_board(board, seed, *process_));
    for (const std::string_view signal : boards_.back()->signal_names()) {
      signals_.push_back({fmt::format("{}.{}", board.name, signal), SignalKind::kValue});
    }
  }
}

Emulator::~Emulator() = default;

const plant::BizoneExtruder& Emulator::extruder() const {
  return process_->extruder();
}

void Emulator::wake(const Wakeup& in, Outbox& out) {
  frames_.clear();
  senders_.clear();
  told_ = 0;
  if (!started_) start();
  for (const can::StampedFrame& stamped : in.frames) {
    const Instant at = std::max(stamped.at, now_);
    run_timers_before(at);
    advance(at);
    deliver(stamped.frame);
    advance(at);  // What the frame has changed without latency.
  }
  run_timers_before(in.now);
  advance(in.now);
  run_timers_before(in.now + 1ns);
  for (const auto& board : boards_) board->settle(now_);

  for (const can::CanFrame& frame : frames_) out.send(frame);
  report_plant(out);
  out.wake_at(std::max(next_deadline(), in.now));
}

void Emulator::start() {
  started_ = true;
  for (std::size_t i = 0; i < boards_.size(); ++i) {
    boards_[i]->start(now_, frames_);
    mark_sender(i);
  }
  tell_others();
}

void Emulator::deliver(const can::CanFrame& frame) {
  for (std::size_t i = 0; i < boards_.size(); ++i) {
    boards_[i]->on_frame(now_, frame, frames_);
    mark_sender(i);
  }
  tell_others();
}

/// Everything that falls due before `limit`, in the order of time, each at its own instant.
void Emulator::run_timers_before(Instant limit) {
  for (Instant due = next_deadline(); due < limit; due = next_deadline()) {
    advance(std::max(due, now_));
    for (std::size_t i = 0; i < boards_.size(); ++i) {
      if (boards_[i]->next_deadline() > now_) continue;
      boards_[i]->on_time(now_, frames_);
      mark_sender(i);
    }
    tell_others();
    advance(now_);
  }
}

/// Takes plant and boards to an instant, stopping wherever a board samples or moves something.
void Emulator::advance(Instant to) {
  for (;;) {
    board::Board* first = nullptr;
    Instant next = to;
    for (const auto& board : boards_) {
      const Instant touch = board->next_touch(next);
      if (touch < next || (first == nullptr && touch == next)) {
        first = board.get();
        next = touch;
      }
    }
    process_->advance_to(next);
    if (first == nullptr) break;
    first->touch(next);
  }
  now_ = std::max(now_, to);
}

void Emulator::mark_sender(std::size_t board) {
  senders_.resize(frames_.size(), board);
}

/// The boards share a wire: what one sends the others hear.
void Emulator::tell_others() {
  for (; told_ < frames_.size(); ++told_) {
    const std::size_t sender = senders_[told_];
    const can::CanFrame frame = frames_[told_];  // A copy: answers may move the vector.
    for (std::size_t i = 0; i < boards_.size(); ++i) {
      if (i == sender) continue;
      boards_[i]->on_frame(now_, frame, frames_);
      mark_sender(i);
    }
  }
}

Instant Emulator::next_deadline() const {
  Instant next = Instant::never();
  for (const auto& board : boards_) next = std::min(next, board->next_deadline());
  return next;
}

void Emulator::report_plant(Outbox& out) {
  for (const auto& board : boards_) {
    if (!board->has_events()) continue;
    for (Event& event : board->take_events()) {
      out.report(event.severity, event.at, std::move(event.code), std::move(event.text));
    }
  }
  const bool flooded = process_->extruder().x_m() >= process_->extruder().parameters().length_m;
  if (flooded && !was_flooded_) {
    out.report(Severity::kWarning, now_, "screw-flooded", "the filled zone has reached the feed throat");
  }
  was_flooded_ = flooded;
}

void Emulator::read_signals(std::span<double> values) const {
  const plant::BizoneOutputs& p = process_->outputs();
  const std::array plant_values{p.x_m,           p.U,           p.delay_s,         p.delay_rate,
                                p.flow_kg_per_s, p.pressure_Pa, p.speed_m_per_s,   p.conveyed_m,
                                p.feed_kg_per_s, p.spill_m,     p.mass_residual_m, p.rejected_feed_kg};
  static_assert(plant_values.size() == kPlantSignals.size());
  std::copy(plant_values.begin(), plant_values.end(), values.begin());
  values = values.subspan(plant_values.size());
  for (const auto& board : boards_) {
    const std::size_t count = board->signal_names().size();
    board->read_signals(values.first(count));
    values = values.subspan(count);
  }
}

}  // namespace meltbench::emulator
