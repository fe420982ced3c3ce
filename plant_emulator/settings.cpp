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
using plant::BizoneParameters;

constexpr double kSecondsPerHour = 3600.0;

plant::FluctuationPlace read_place(const Section& section) {
  return section.choice_or<plant::FluctuationPlace>(
      "fluctuation_on", plant::FluctuationPlace::kScrew,
      {{"screw", plant::FluctuationPlace::kScrew}, {"slip", plant::FluctuationPlace::kSlip}});
}

BizoneParameters read_plant(const Section& section) {
  using config::above;
  const auto preset = section.choice_or<plant::Preset>("preset", plant::Preset::kSlow,
                                                       {{"paper", plant::Preset::kPaper},
                                                        {"slow", plant::Preset::kSlow},
                                                        {"phys", plant::Preset::kPhys},
                                                        {"rad", plant::Preset::kRad}});
  const auto fluctuation = section.choice_or<plant::FluctuationCase>(
      "fluctuation_case", plant::FluctuationCase::kA,
      {{"none", plant::FluctuationCase::kNone}, {"A", plant::FluctuationCase::kA}, {"B", plant::FluctuationCase::kB}});
  BizoneParameters p = plant::make_parameters(preset, fluctuation);
  p.fluctuation_place = read_place(section);
  p.delay_reading = section.choice_or<plant::DelayReading>(
      "delay_model", p.delay_reading,
      {{"transport", plant::DelayReading::kTransport}, {"paper", plant::DelayReading::kPaper}});
  const auto positive = [&](std::string_view key, double& value) { value = section.number_or(key, value, above(0)); };
  positive("length_m", p.length_m);
  positive("pitch_m", p.pitch_m);
  positive("density_kg_per_m3", p.density_kg_per_m3);
  positive("pressure_flow_m4", p.pressure_flow_m4);
  positive("nozzle_kg", p.nozzle_kg);
  positive("area_m2", p.area_m2);
  positive("viscosity_Pa_s", p.viscosity_Pa_s);
  positive("speed_m_per_s", p.speed_m_per_s);
  p.fluctuation = section.number_or("epsilon", p.fluctuation, config::from_below(0, 1));
  p.fluctuation_rad_per_s = section.number_or("omega_rad_per_s", p.fluctuation_rad_per_s, config::at_least(0));
  p.fluctuation_phase_rad = section.number_or("phase_rad", p.fluctuation_phase_rad);
  p.x0_m = section.number_or("x0_m", p.x0_m, config::between(0, p.length_m, "inside the screw: 0..length_m"));
  if (section.has("U_before_start")) {
    p.U_before_start = section.number("U_before_start", config::between(0, plant::kMaxFillRatio));
  }
  try {
    p.check();
  } catch (const std::invalid_argument& error) {
    section.fail_here(error.what());
  }
  return p;
}

board::PlantRates calc_rates(const Section& section, const BizoneParameters& p) {
  const double nominal_x_m = section.number_or("nominal_x_m", 0.8 * p.length_m, config::inside(0, p.length_m));
  return {.start_flow_kg_per_h = p.holding_feed_kg_per_s(p.x0_m) * kSecondsPerHour,
          .hold_flow_kg_per_h = p.holding_feed_kg_per_s(nominal_x_m) * kSecondsPerHour,
          .throat_flow_kg_per_h = p.mass_per_length_kg_per_m() * p.speed_m_per_s * kSecondsPerHour,
          .screw_rev_per_s = p.speed_m_per_s / p.pitch_m};
}

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
  BoardSettings settings{board.name, board.node_id, read_dictionary(board), {}};
  switch (board.kind) {
    case BoardKind::kFeeder:
      settings.firmware = board::read_feeder_settings(board.section, rates);
      break;
    case BoardKind::kScrewDrive:
      settings.firmware = board::read_screw_drive_settings(board.section, rates);
      break;
    case BoardKind::kMeltPressure:
      settings.firmware = board::read_melt_pressure_settings(board.section);
      break;
  }
  board.section.finish();
  return settings;
}

}  // namespace

EmulatorSettings read_settings(const config::Section& root, const config::Rig& rig) {
  const Section section = root.section_or_empty("plant");
  EmulatorSettings settings{read_plant(section), {}};
  const board::PlantRates rates = calc_rates(section, settings.plant);
  std::array<const config::RigBoard*, 3> of_kind{};
  for (const config::RigBoard& board : rig.boards) {
    const config::RigBoard*& first = of_kind.at(static_cast<std::size_t>(board.kind));
    if (first != nullptr) {
      board.section.fail("kind", fmt::format("must not be there twice: board {} is one too", first->name),
                         "this extruder has one feeder, one screw drive and one melt pressure transmitter");
    }
    first = &board;
    settings.boards.push_back(read_board(board, rates));
    try {
      const Emulator trial{{settings.plant, {settings.boards.back()}}, 0};
    } catch (const std::exception& error) {
      board.section.fail("eds", fmt::format("must describe a {}: {}", config::name_of(board.kind), error.what()),
                         "fixtures/boards/ has one of each kind");
    }
  }
  return settings;
}

}  // namespace meltbench::emulator
