#pragma once

#include <string>
#include <vector>

#include "protocols/participant/participant.hpp"
#include "protocols/serial/line_port.hpp"

namespace meltbench::runtime {

/// How a program joins the wire.
struct ProgramOptions {
  std::string can = "virtual:bench";    ///< "virtual:NAME" or a kernel interface.
  std::string bench;                    ///< "virtual:NAME" of a bench to report to when the frames go over the kernel.
  std::vector<serial::LinePort> lines;  ///< Serial lines that are ports of this machine; the bench carries the others.
  int rt_priority = 0;  ///< SCHED_FIFO priority at wall-clock pace, 1..99; 0: the user's own scheduling.
};

/// Joins the wire, takes the driver that it asks for (lockstep or real time), and runs until told to stop.
/// Catches SIGINT and SIGTERM. Events go to the bench, or to standard error when there is none.
/// @returns the process's exit status: 0, or 3 if the bench was lost.
/// @throws link::LinkError if the wire cannot be joined, a serial line has no port, or the priority is refused.
[[nodiscard]] int run_program(Participant& participant, const ProgramOptions& options);

/// Tells the user what is wrong with what the program was given: "error: ..." and, if there is one, "hint: ...".
/// @returns the exit status for that: 2.
int complain(const std::string& what, const std::string& hint);

}  // namespace meltbench::runtime
