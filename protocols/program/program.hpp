#pragma once
/// What the programs on a wire have in common, the plant emulator and the controller: options, complaints, drivers.

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "protocols/config/rig.hpp"
#include "protocols/config/section.hpp"
#include "protocols/participant/participant.hpp"

namespace CLI {
class App;
}

namespace meltbench::program {

/// What a program is, and how it joins the wire.
struct ProgramOptions {
  std::string rig;                    ///< File of the machine's description.
  std::string can = "virtual:bench";  ///< "virtual:NAME", a kernel interface, an slcan adapter, "none".
  std::string bench;                  ///< "virtual:NAME" of a bench to report to when the frames go over the kernel.
  std::vector<std::string> lines;     ///< "LINE=PORT": those that are ports of this machine; the bench carries others.
  int rt_priority = 0;                ///< SCHED_FIFO priority at wall-clock pace, 1..99; 0: the user's own scheduling.
};

/// Makes the participant from the rig's file. It may throw: run() tells the user.
using MakeParticipant =
    std::function<std::unique_ptr<Participant>(const config::Section& root, const config::Rig& rig)>;

/// @param app  with its name, which the examples in its help begin with.
void add_options(CLI::App& app, ProgramOptions& options);

/// The program: reads its words, makes the participant, joins the wire with the driver that it asks for (lockstep or
/// real time), and runs until told to stop. Catches SIGINT and SIGTERM. Events go to the bench, or to standard error
/// when there is none.
/// @returns the process's exit status: 0; 2 if the words, the rig, or the wire are no good, which it says; 3 if the
/// bench
///          was lost.
[[nodiscard]] int run(CLI::App& app, const ProgramOptions& options, int argc, char** argv, const MakeParticipant& make);

/// Tells the user what is wrong with what the program was given: "error: ..." and, if there is one, "hint: ...".
/// @returns the exit status for that: 2.
int complain(const std::string& what, const std::string& hint);

}  // namespace meltbench::program
