/// The plant emulator as a program: an extruder and its field boards on the wire that it is told, until told to stop.

#include <CLI/CLI.hpp>
#include <cstdint>
#include <exception>
#include <string>

#include "plant_emulator/emulator.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/toml.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/program.hpp"

namespace {

meltbench::emulator::EmulatorSettings read_settings(const std::string& file) {
  const meltbench::config::Section root{meltbench::config::read_toml_file(file)};
  auto settings = meltbench::emulator::read_settings(root, meltbench::config::read_rig(root));
  root.finish();
  return settings;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"plant_emulator - a polymer screw extruder behind CANopen field boards"};
  std::string rig;
  std::uint64_t seed = 1;
  meltbench::runtime::ProgramOptions options;
  app.add_option("--rig", rig, "machine description (TOML)")->required();
  app.add_option("--can", options.can, "virtual:NAME | can0, vcan0 ...")->capture_default_str();
  app.add_option("--rt", options.rt_priority, "SCHED_FIFO priority, 1..99, with locked memory; for a wall-clock bus")
      ->check(CLI::Range(1, 99));
  app.add_option("--bench", options.bench, "virtual:NAME of a bench to report to when the frames go over the kernel");
  app.add_option("--seed", seed, "phases of the boards' clocks, noise")->capture_default_str();
  app.footer(
      "Exit status: 0 told to stop, 2 bad usage or file, 3 the bench was lost\n"
      "Example: plant_emulator --rig fixtures/rigs/bizone.toml --can can0");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help.
    return meltbench::runtime::complain(error.what(), "see plant_emulator --help");
  }
  try {
    meltbench::emulator::Emulator emulator{read_settings(rig), seed};
    return meltbench::runtime::run_program(emulator, options);
  } catch (const meltbench::config::ConfigError& error) {
    return meltbench::runtime::complain(error.what(), error.hint());
  } catch (const meltbench::link::LinkError& error) {
    return meltbench::runtime::complain(error.what(), error.hint());
  } catch (const std::exception& error) {
    return meltbench::runtime::complain(error.what(), {});
  }
}
