/// The plant emulator as a program: an extruder and its field boards on the wire that it is told, until told to stop.

#include <CLI/CLI.hpp>
#include <cstdint>
#include <exception>
#include <string>
#include <utility>
#include <vector>

#include "plant_emulator/emulator.hpp"
#include "protocols/config/line_ports.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/toml.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/program.hpp"

int main(int argc, char** argv) {
  CLI::App app{"plant_emulator - a polymer screw extruder behind CANopen field boards"};
  std::string rig;
  std::uint64_t seed = 1;
  std::vector<std::string> lines;
  meltbench::runtime::ProgramOptions options;
  app.add_option("--rig", rig, "machine description (TOML)")->required();
  app.add_option("--can", options.can, "virtual:NAME | can0, vcan0 ... | slcan:/dev/ttyACM0@500000 | none")
      ->capture_default_str();
  app.add_option("--line", lines,
                 "LINE=PORT: a serial line of the rig is this port, e.g. hopper=/dev/ttyUSB0, hopper=pty:/tmp/hopper");
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
    const meltbench::config::Section root{meltbench::config::read_toml_file(rig)};
    const meltbench::config::Rig machine = meltbench::config::read_rig(root);
    options.lines = meltbench::config::read_line_ports(lines, machine);
    auto settings = meltbench::emulator::read_settings(root, machine);
    root.finish();
    meltbench::emulator::Emulator emulator{std::move(settings), seed};
    return meltbench::runtime::run_program(emulator, options);
  } catch (const meltbench::config::ConfigError& error) {
    return meltbench::runtime::complain(error.what(), error.hint());
  } catch (const meltbench::link::LinkError& error) {
    return meltbench::runtime::complain(error.what(), error.hint());
  } catch (const std::exception& error) {
    return meltbench::runtime::complain(error.what(), {});
  }
}
