/// The controller as a program: joins the wire that it is told, and runs until it is told to stop.

#include <CLI/CLI.hpp>
#include <memory>

#include "controller/machine/controller.hpp"
#include "controller/machine/settings.hpp"
#include "protocols/participant/restartable.hpp"
#include "protocols/program/program.hpp"

using namespace meltbench;

int main(int argc, char** argv) {
  CLI::App app{"controller - hold filled length, melting front and zones of a screw extruder over CANopen",
               "controller"};
  program::ProgramOptions options;
  program::add_options(app, options);
  return program::run(app, options, argc, argv, [](const config::Section& root, const config::Rig&) {
    return std::make_unique<Restartable>(
        [settings = machine::read_settings(root)] { return std::make_unique<machine::Controller>(settings); });
  });
}
