#include "plant_emulator/emulator.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include <fmt/format.h>

#include "plant_emulator/bizone_plant.hpp"
#include "plant_emulator/board/feeder.hpp"
#include "plant_emulator/board/heater.hpp"
#include "plant_emulator/board/melt_camera.hpp"
#include "plant_emulator/board/melt_pressure.hpp"
#include "plant_emulator/board/preconditioner.hpp"
#include "plant_emulator/board/rtu_feeder.hpp"
#include "plant_emulator/board/rtu_heater.hpp"
#include "plant_emulator/board/screw_drive.hpp"

namespace meltbench::emulator {

namespace {

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
    } else if constexpr (std::is_same_v<Firmware, board::MeltPressureSettings>) {
      return build(std::type_identity<board::MeltPressure>{});
    } else if constexpr (std::is_same_v<Firmware, board::HeaterSettings>) {
      return build(std::type_identity<board::Heater>{});
    } else if constexpr (std::is_same_v<Firmware, board::PreconditionerSettings>) {
      return build(std::type_identity<board::Preconditioner>{});
    } else {
      return build(std::type_identity<board::MeltCamera>{});
    }
  };
  return std::visit(make, settings.firmware);
}

config::BoardKind kind_of(const BoardSettings& settings) {
  using config::BoardKind;
  // In the order of BoardSettings::firmware.
  constexpr std::array kKinds{BoardKind::kFeeder, BoardKind::kScrewDrive,     BoardKind::kMeltPressure,
                              BoardKind::kHeater, BoardKind::kPreconditioner, BoardKind::kMeltCamera};
  return kKinds.at(settings.firmware.index());
}

std::unique_ptr<board::RtuBoard> make_rtu_board(const BoardSettings& settings, std::uint64_t seed,
                                                board::Process& process) {
  const board::Chance chance{seed, settings.name};
  if (const auto* feeder = std::get_if<board::FeederSettings>(&settings.firmware)) {
    return std::make_unique<board::RtuFeeder>(settings.name, settings.unit, *feeder, chance, process);
  }
  if (const auto* heater = std::get_if<board::HeaterSettings>(&settings.firmware)) {
    return std::make_unique<board::RtuHeater>(settings.name, settings.unit, *heater, chance, process);
  }
  throw std::invalid_argument(fmt::format("there is no such board as {} for a serial line", settings.name));
}

std::unique_ptr<Plant> make_plant(const EmulatorSettings& settings) {
  const auto make = [](const auto& plant) -> std::unique_ptr<Plant> {
    using Settings = std::decay_t<decltype(plant)>;
    if constexpr (std::is_same_v<Settings, plant::BizoneParameters>) {
      return std::make_unique<BizonePlant>(plant);
    } else if constexpr (std::is_same_v<Settings, MeltPlantSettings>) {
      return std::make_unique<MeltPlant>(plant);
    } else {
      return std::make_unique<CoupledPlant>(plant);
    }
  };
  return std::visit(make, settings.plant);
}

}  // namespace

Emulator::Emulator(const EmulatorSettings& settings, std::uint64_t seed)
    : plant_{make_plant(settings)},
      process_{*plant_, seed},
      truth_count_{settings.knows_truth ? plant_->signals().size() : 0},
      knows_truth_{settings.knows_truth},
      signals_{plant_->signals().begin(), plant_->signals().begin() + static_cast<std::ptrdiff_t>(truth_count_)},
      material_changes_{settings.material_changes} {
  for (const config::RigLine& line : settings.lines) serial_.add_line(line.name, line.settings);
  for (const BoardSettings& board : settings.boards) {
    if (board.line.empty()) {
      devices_.push_back(boards_.emplace_back(make_board(board, seed, process_)).get());
      gates_.emplace_back(*boards_.back(), kind_of(board), process_);
      nodes_.push_back(board.name);
    } else {
      devices_.push_back(&serial_.add(make_rtu_board(board, seed, process_), kind_of(board), board.line, process_));
    }
    for (const std::string_view signal : devices_.back()->signal_names()) {
      signals_.push_back({fmt::format("{}.{}", board.name, signal), SignalKind::kValue});
    }
  }
}

Emulator::~Emulator() = default;

void Emulator::wake(const Wakeup& in, Outbox& out) {
  frames_.clear();
  senders_.clear();
  told_ = 0;
  wire_tells_ = !in.nodes.empty();
  if (!started_) start();
  serial_.on_lines(in.lines);
  take_arrivals(in);
  if (!in.orders.empty()) {
    run_timers_before(in.now);
    advance(in.now);
    for (const std::string& order : in.orders) obey(order);
  }
  run_timers_before(in.now);
  advance(in.now);
  run_timers_before(in.now + 1ns);
  plant_->settle(now_);
  for (board::Device* device : devices_) device->settle(now_);

  send_all(out);
  serial_.write_answers(out);
  report_boards(out);
  if (knows_truth_) plant_->report(now_, out);
  out.wake_at(std::max(next_deadline(), in.now));
}

/// Frames and bytes in the order of time.
void Emulator::take_arrivals(const Wakeup& in) {
  auto serial = in.serial.begin();
  const auto come_to = [&](Instant at) {
    run_timers_before(std::max(at, now_));
    advance(std::max(at, now_));
  };
  const auto take_serial_before = [&](Instant limit) {
    for (; serial != in.serial.end() && serial->at < limit; ++serial) {
      come_to(serial->at);
      serial_.on_bytes(now_, *serial);
      advance(now_);
    }
  };
  for (const can::StampedFrame& stamped : in.frames) {
    take_serial_before(stamped.at);
    come_to(stamped.at);
    deliver(stamped.frame, in.nodes);
    advance(now_);  // What the frame has changed without latency.
  }
  take_serial_before(Instant::never());
}

void Emulator::send_all(Outbox& out) const {
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    out.speak_as(static_cast<std::uint8_t>(senders_[i]));
    out.send(frames_[i]);
  }
}

void Emulator::start() {
  started_ = true;
  serial_.start(now_);
  for (std::size_t i = 0; i < boards_.size(); ++i) {
    gates_[i].start(now_, frames_);
    mark_sender(i);
  }
  tell_others();
}

/// Orders of the bench: faults that begin and end. Whatever else it asks for is not for the extruder.
void Emulator::obey(const std::string& text) {
  const std::optional<fault::FaultOrder> order = fault::read_order(text);
  if (!order) return;
  for (std::size_t i = 0; i < gates_.size(); ++i) {
    if (order->fault.target != fault::Target::kBoard || boards_[i]->name() != order->fault.object) continue;
    if (order->begins) {
      gates_[i].begin(order->number, order->fault, now_, frames_);
    } else {
      gates_[i].end(order->number, now_, frames_);
    }
    mark_sender(i);
  }
  if (order->begins) {
    serial_.begin(order->number, order->fault, now_);
    process_.begin(order->number, order->fault);
  } else {
    serial_.end(order->number, now_);
    process_.end(order->number);
  }
  tell_others();
}

void Emulator::deliver(const can::CanFrame& frame, std::span<const can::ErrorState> states) {
  for (std::size_t i = 0; i < boards_.size(); ++i) {
    if (i < states.size() && states[i] == can::ErrorState::kBusOff) continue;
    gates_[i].on_frame(now_, frame, frames_);
    mark_sender(i);
  }
  tell_others();
}

/// Everything that falls due before `limit`, in the order of time, each at its own instant.
void Emulator::run_timers_before(Instant limit) {
  for (Instant due = next_deadline(); due < limit; due = next_deadline()) {
    advance(std::max(due, now_));
    for (; next_change_ < material_changes_.size() && material_changes_[next_change_].at <= now_; ++next_change_) {
      plant_->change_polymer(material_changes_[next_change_].polymer);
    }
    for (std::size_t i = 0; i < boards_.size(); ++i) {
      if (gates_[i].next_deadline() > now_) continue;
      gates_[i].on_time(now_, frames_);
      mark_sender(i);
    }
    serial_.on_time(now_);
    tell_others();
    advance(now_);
  }
}

/// Takes plant and boards to an instant, stopping wherever a board samples or moves something.
void Emulator::advance(Instant to) {
  for (;;) {
    board::Device* first = nullptr;
    Instant next = to;
    for (board::Device* device : devices_) {
      const Instant touch = device->next_touch(next);
      if (touch < next || (first == nullptr && touch == next)) {
        first = device;
        next = touch;
      }
    }
    const Instant moves = process_.next_touch(next);
    process_.advance_to(std::min(moves, next));
    if (moves <= next) {
      process_.touch(moves);
      continue;
    }
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
  if (wire_tells_) return;
  for (; told_ < frames_.size(); ++told_) {
    const std::size_t sender = senders_[told_];
    const can::CanFrame frame = frames_[told_];  // A copy: answers may move the vector.
    for (std::size_t i = 0; i < boards_.size(); ++i) {
      if (i == sender) continue;
      gates_[i].on_frame(now_, frame, frames_);
      mark_sender(i);
    }
  }
}

Instant Emulator::next_deadline() const {
  Instant next = next_change_ < material_changes_.size() ? material_changes_[next_change_].at : Instant::never();
  for (const BoardGate& gate : gates_) next = std::min(next, gate.next_deadline());
  return std::min(next, serial_.next_deadline());
}

void Emulator::report_boards(Outbox& out) {
  for (BoardGate& gate : gates_) gate.forget_dark_events();
  serial_.forget_dark_events();
  for (board::Device* device : devices_) {
    if (!device->has_events()) continue;
    for (Event& event : device->take_events()) {
      out.report(event.severity, event.at, std::move(event.code), std::move(event.text));
    }
  }
}

void Emulator::read_signals(std::span<double> values) const {
  if (knows_truth_) plant_->read_signals(values.first(truth_count_));
  values = values.subspan(truth_count_);
  for (const board::Device* device : devices_) {
    const std::size_t count = device->signal_names().size();
    device->read_signals(values.first(count));
    values = values.subspan(count);
  }
}

}  // namespace meltbench::emulator
