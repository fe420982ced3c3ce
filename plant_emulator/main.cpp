/// The plant emulator as a program: an extruder and its field boards on the wire that it is told, until told to stop.

#include <CLI/CLI.hpp>
#include <cstdint>
#include <memory>
#include <utility>

#include "plant_emulator/emulator.hpp"
#include "protocols/program/program.hpp"

using namespace meltbench;

int main(int argc, char** argv) {
  CLI::App app{"plant_emulator - a polymer screw extruder behind CANopen field boards", "plant_emulator"};
  program::ProgramOptions options;
  std::uint64_t seed = 1;
  program::add_options(app, options);
  app.add_option("--seed", seed, "phases of the boards' clocks, noise")->capture_default_str();
  return program::run(app, options, argc, argv, [&seed](const config::Section& root, const config::Rig& rig) {
    auto settings = emulator::read_settings(root, rig);
    root.finish();
    return std::make_unique<emulator::Emulator>(std::move(settings), seed);
  });
}
