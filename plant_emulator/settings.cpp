#include <algorithm>
#include <array>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include <fmt/format.h>

#include "plant_emulator/emulator.hpp"
#include "protocols/canopen/eds.hpp"

namespace meltbench::emulator {

namespace {

using config::BoardKind;
using config::Section;

std::shared_ptr<const canopen::ObjectDictionary> read_dictionary(const config::RigBoard& board) {
  std::ifstream file{board.eds, std::ios::binary};
  const std::string text{std::istreambuf_iterator<char>{file}, {}};
  if (!file) board.section.fail("eds", "cannot be read", board.eds.string());
  try {
    return std::make_shared<canopen::ObjectDictionary>(
        canopen::read_eds(text, board.eds.string(), board.node_id).dictionary);
  } catch (const canopen::EdsError& error) {
    board.section.fail("eds", fmt::format("must be a sound EDS: {}", error.what()), error.hint());
  }
}

BoardSettings read_board(const config::RigBoard& board, const board::PlantRates& rates) {
  const bool on_line = board.is_on_line();
  if (on_line && board.kind != BoardKind::kFeeder && board.kind != BoardKind::kHeater) {
    board.section.fail("line", fmt::format("a {} speaks CANopen only", config::name_of(board.kind)),
                       "give it node_id and eds instead; feeder and heater can be on a line");
  }
  BoardSettings settings{board.name, board.node_id, on_line ? nullptr : read_dictionary(board),
                         {},         board.line,    board.unit};
  switch (board.kind) {
    case BoardKind::kFeeder: {
      board::FeederSettings feeder = board::read_feeder_settings(board.section, rates);
      if (on_line) board::read_serial_settings(board.section, feeder);
      settings.firmware = feeder;
      break;
    }
    case BoardKind::kScrewDrive:
      settings.firmware = board::read_screw_drive_settings(board.section, rates);
      break;
    case BoardKind::kMeltPressure:
      settings.firmware = board::read_melt_pressure_settings(board.section);
      break;
    case BoardKind::kPreconditioner:
      settings.firmware = board::read_preconditioner_settings(board.section, rates);
      break;
    case BoardKind::kMeltCamera:
      settings.firmware = board::read_melt_camera_settings(board.section);
      break;
    case BoardKind::kHeater: {
      if (rates.barrel_zones == 0) {
        board.section.fail("kind", "must not be \"heater\": this plant has a barrel of one constant temperature",
                           "[plant] kind = \"coupled\" has heated zones");
      }
      board::HeaterSettings heater = board::read_heater_settings(board.section, rates);
      if (on_line) board::read_serial_settings(board.section, heater);
      settings.firmware = heater;
      break;
    }
  }
  board.section.finish();
  return settings;
}

/// A heater is the units of its zones: nobody else may be one of them.
void check_units(const config::Rig& rig) {
  constexpr int kZones = 5;
  for (const config::RigBoard& heater : rig.boards) {
    if (!heater.is_on_line() || heater.kind != BoardKind::kHeater) continue;
    for (const config::RigBoard& other : rig.boards) {
      const int above = other.unit - heater.unit;
      if (other.line != heater.line || above <= 0 || above >= kZones) continue;
      other.section.fail("unit", fmt::format("already taken by a zone of board.{}", heater.name),
                         "the zones of a heater are its unit and the next four");
    }
    if (heater.unit > 247 - kZones + 1) {
      heater.section.fail("unit", "must be at most 243", "the zones of a heater are its unit and the next four");
    }
  }
}

}  // namespace

EmulatorSettings read_settings(const config::Section& root, const config::Rig& rig) {
  check_units(rig);
  const PlantReading plant = read_plant(root.section_or_empty("plant"));
  if (!rig.has_emulated_board()) {
    root.fail_here("every board of this rig is real: there is nothing to emulate",
                   "part = \"emulated\", the default, makes a board ours");
  }
  EmulatorSettings settings{plant.plant, {}, !rig.has_real_board(), {}};
  settings.material_changes = read_material_changes(config::read_events(root, rig, "plant"), settings.plant);
  for (const config::RigLine& line : rig.lines) {
    const bool used = std::any_of(rig.boards.begin(), rig.boards.end(), [&](const config::RigBoard& board) {
      return !board.is_real && board.line == line.name;
    });
    if (used) settings.lines.push_back(line);
  }
  std::array<const config::RigBoard*, config::kBoardKinds> of_kind{};
  for (const config::RigBoard& board : rig.boards) {
    const config::RigBoard*& first = of_kind.at(static_cast<std::size_t>(board.kind));
    if (first != nullptr) {
      board.section.fail("kind", fmt::format("must not be there twice: board {} is one too", first->name),
                         "an extruder has one board of each kind");
    }
    first = &board;
    if (board.is_real) continue;  // Its other keys are for the day when it is emulated.
    settings.boards.push_back(read_board(board, plant.rates));
    try {
      const Emulator trial{{settings.plant, {settings.boards.back()}, true, {}, settings.lines}, 0};
    } catch (const std::exception& error) {
      board.section.fail("eds", fmt::format("must describe a {}: {}", config::name_of(board.kind), error.what()),
                         "fixtures/boards/ has one of each kind");
    }
  }
  return settings;
}

}  // namespace meltbench::emulator
