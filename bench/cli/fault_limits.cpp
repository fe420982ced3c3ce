#include "bench/cli/fault_limits.hpp"

#include <algorithm>
#include <memory>

#include "protocols/link/can_link.hpp"

namespace meltbench::cli {
namespace {

using Frames = FaultLimits::Frames;

Frames find_carrier(const RunRequest& request) {
  if (request.can.empty()) return Frames::kByBench;
  switch (link::parse_bus_uri(request.can).kind) {
    case link::BusUri::Kind::kSocketCan:
      return Frames::kByKernel;
    case link::BusUri::Kind::kSlcan:
      return Frames::kByAdapter;
    default:
      return Frames::kByBench;
  }
}

/// Of the wire or of frames on it.
void require_own_bus(const config::Section& section, Frames carrier) {
  if (carrier == Frames::kByKernel) {
    section.fail("target", "the kernel carries the frames of this run, the bench only listens",
                 "without --can, or with --can virtual:NAME, the bench carries them; on vcan and can interfaces cangw "
                 "(can-utils) drops and changes frames");
  }
  if (carrier == Frames::kByAdapter) {
    section.fail("target", "the bus of this run is behind an adapter, where the bench cannot hold up frames",
                 "without --can, or with --can virtual:NAME, the bench carries them");
  }
}

void require_own_line(const config::Section& section, const std::string& line, const std::vector<std::string>& ports) {
  const auto port = std::ranges::find_if(ports, [&](const std::string& one) { return one.starts_with(line + "="); });
  if (port == ports.end()) return;
  section.fail("target", "the bench does not carry this line: it is the port " + port->substr(line.size() + 1),
               "leave its --line away");
}

void require_emulator(const config::Section& section, const fault::Fault& fault, const FaultLimits& limits) {
  if (!limits.has_emulator) section.fail("target", "every board of this rig is real", "make them fail by hand");
  if (fault.target == fault::Target::kPlant && limits.has_real_board) {
    section.fail("target", "boards of this rig are real", "the model is not the machine");
  }
}

}  // namespace

FaultLimits find_limits(const PreparedRun& prepared, const RunRequest& request) {
  FaultLimits limits;
  limits.in_virtual_time = prepared.pace.is_virtual();
  limits.frames = find_carrier(request);
  limits.has_emulator = prepared.plant != nullptr;
  limits.has_real_board = prepared.run.rig.has_real_board();
  limits.controller_joins_late = prepared.controller == nullptr && !limits.in_virtual_time;
  limits.ports = prepared.plant_lines;
  limits.ports.insert(limits.ports.end(), prepared.controller_lines.begin(), prepared.controller_lines.end());
  return limits;
}

void require_possible(const fault::Fault& fault, const FaultLimits& limits) {
  const config::Section section{std::make_shared<const config::Table>(fault.table), "fault"};
  switch (fault.target) {
    case fault::Target::kFrame:
      return require_own_bus(section, limits.frames);
    case fault::Target::kBus:
      if (fault.object == "controller" && limits.controller_joins_late) {
        section.fail("target", "the controller is external", "make its own bus connection fail");
      }
      return require_own_bus(section, limits.frames);
    case fault::Target::kLine:
      return require_own_line(section, fault.object, limits.ports);
    case fault::Target::kClock:
      if (limits.in_virtual_time) return;
      section.fail("target", "at wall-clock pace all programs have the clock of this machine",
                   "leave --pace and --can away: in virtual time each has its own");
    case fault::Target::kProgram:
      if (limits.in_virtual_time || fault.kind() == fault::Kind::kRestart) return;
      section.fail("kind", "at wall-clock pace the run would end with its program",
                   "\"restart\" can be done; or leave --pace and --can away");
    case fault::Target::kBoard:
      // The second device is on the bench's own bus.
      if (fault.kind() == fault::Kind::kSameNodeId) require_own_bus(section, limits.frames);
      return require_emulator(section, fault, limits);
    case fault::Target::kSensor:
    case fault::Target::kActuator:
    case fault::Target::kPlant:
      return require_emulator(section, fault, limits);
  }
}

}  // namespace meltbench::cli
