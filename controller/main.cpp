/// The controller as a program: joins the wire that it is told, and runs until it is told to stop.

#include <CLI/CLI.hpp>
#include <exception>
#include <string>
#include <vector>

#include "controller/machine/controller.hpp"
#include "controller/machine/settings.hpp"
#include "protocols/config/line_ports.hpp"
#include "protocols/config/toml.hpp"
#include "protocols/link/can_link.hpp"
#include "protocols/runtime/program.hpp"

int main(int argc, char** argv) {
  CLI::App app{"controller - hold filled length, melting front and zones of a screw extruder over CANopen"};
  std::string rig;
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
  app.footer(
      "Exit status: 0 told to stop, 2 bad usage or file, 3 the bench was lost\n"
      "Example: controller --rig fixtures/rigs/bizone.toml --can can0");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help.
    return meltbench::runtime::complain(error.what(), "see controller --help");
  }
  try {
    const meltbench::config::Section root{meltbench::config::read_toml_file(rig)};
    options.lines = meltbench::config::read_line_ports(lines, meltbench::config::read_rig(root));
    meltbench::machine::Controller controller{meltbench::machine::read_settings(root)};
    return meltbench::runtime::run_program(controller, options);
  } catch (const meltbench::config::ConfigError& error) {
    return meltbench::runtime::complain(error.what(), error.hint());
  } catch (const meltbench::link::LinkError& error) {
    return meltbench::runtime::complain(error.what(), error.hint());
  } catch (const std::exception& error) {
    return meltbench::runtime::complain(error.what(), {});
  }
}
