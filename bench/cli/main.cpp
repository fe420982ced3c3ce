/// meltbench - run hardware-in-the-loop scenarios against an extruder controller.

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <limits>
#include <string_view>
#include <system_error>

#include "bench/cli/doctor_command.hpp"
#include "bench/cli/extract_command.hpp"
#include "bench/cli/fault_command.hpp"
#include "bench/cli/list_command.hpp"
#include "bench/cli/log_commands.hpp"
#include "bench/cli/record_command.hpp"
#include "bench/cli/replay_command.hpp"
#include "bench/cli/report_command.hpp"
#include "bench/cli/run_command.hpp"
#include "bench/cli/show_command.hpp"
#include "bench/cli/torture_command.hpp"
#include "bench/cli/version.hpp"
#include "bench/log/log_error.hpp"
#include "bench/record/load_recording.hpp"
#include "bench/report/report.hpp"
#include "protocols/config/value.hpp"
#include "protocols/link/can_link.hpp"

namespace {

using namespace meltbench;
using cli::ExitStatus;

int tell(const std::string& what, const std::string& hint, ExitStatus status) {
  fmt::print(stderr, "error: {}\n", what);
  if (!hint.empty()) fmt::print(stderr, "hint: {}\n", hint);
  return static_cast<int>(status);
}

/// TOML, and so repro.toml, knows no larger whole number.
constexpr std::uint64_t kMaxSeed = std::numeric_limits<std::int64_t>::max();

/// What the words of the command line say, whichever command it is.
struct Words {
  cli::RunRequest run;
  std::vector<std::string> taps;
  std::string pace = "lockstep";
  bool in_process = false;
  std::uint64_t seed = 0;  // 0..kMaxSeed
  int rt_priority = 0;
  std::filesystem::path scenarios;
  std::vector<std::filesystem::path> folders;
  std::filesystem::path page;
  std::filesystem::path scenario;
  cli::ReplayRequest replay;
  cli::ShowRequest show;
  cli::FaultRequest fault;
  cli::ExtractRequest extract;
  cli::RecordRequest record;
  cli::TortureRequest torture;
  std::filesystem::path from;
  std::filesystem::path to;
  cli::Examination examination;
};

CLI::App* add_run_command(CLI::App& app, Words& words) {
  CLI::App* run = app.add_subcommand("run", "Run scenarios, judge them, write their folder and a report");
  run->add_option("scenario", words.run.scenarios,
                  "Scenario files; several give one report with their signals overlaid; a folder is a suite")
      ->required();
  run->add_option("--out", words.run.out, "Folder of the results")->default_str("meltbench-out");
  run->add_option("--seed", words.seed, "Instead of the scenario's seed; same seed, same bytes")
      ->check(CLI::Range(std::uint64_t{0}, kMaxSeed));
  run->add_option("--pace", words.pace,
                  "lockstep | realtime | realtime:FACTOR  (default: lockstep, realtime on a kernel bus or with real "
                  "parts)");
  run->add_flag("--in-process", words.in_process, "Virtual time without processes: same recording, faster");
  run->add_option("--can", words.run.can,
                  "virtual:NAME | can0, vcan0 ... | slcan:/dev/ttyACM0@500000; all but the first run at --pace "
                  "realtime  (default: a "
                  "bus of this run alone)");
  run->add_option("--controller-can", words.run.controller_can,
                  "Another kernel interface for the controller, on the same wire as the boards' --can");
  run->add_option("--line", words.run.lines,
                  "LINE=PORT: a serial line of the rig is this port, e.g. hopper=/dev/ttyUSB0: the boards' if they are "
                  "emulated, else the controller's; runs at --pace realtime");
  run->add_option("--controller-line", words.run.controller_lines,
                  "LINE=PORT: the controller's port, where the emulated boards have another one on the same wire");
  run->add_option(
         "--rt", words.rt_priority,
         "Wall-clock pace: SCHED_FIFO priority, 1..99, of the controller; the boards one below, and on an embedded "
         "bus the bench as the controller")
      ->check(CLI::Range(1, 99));
  run->add_option(
         "--tap", words.taps,
         "PORT | unix:PATH: lets python-can, SavvyCAN ... on the embedded bus (socketcand, its port is 29536); "
         "can:vcan0: puts it on this kernel interface, too, for candump, cansend ..., at --pace realtime")
      ->allow_extra_args(false);
  run->add_option("--slcan-pty", words.run.tap.slcan_pty,
                  "PATH: lets a program on the embedded bus that speaks to an slcan adapter there");
  run->add_flag("--tap-read-only", words.run.tap.read_only, "They may look, not send");
  run->add_option("--tap-wait", words.run.tap_wait, "The run begins when so many of them look at the bus");
  run->add_flag("--quiet", words.run.quiet, "Print failures, the sum and the report's place only");
  run->footer(
      "Exit status: 0 all checks held, 1 a check failed, 2 bad usage or file, 3 a process or link was lost\n"
      "Example: meltbench run fixtures/scenarios/delay_compensation.toml --out first");
  return run;
}

void add_torture_command(CLI::App& app, cli::TortureRequest& request) {
  CLI::App* torture = app.add_subcommand("torture", "Run scenarios with faults by chance, many times, in memory");
  torture->add_option("scenario", request.scenarios, "Machines and durations; seeds take turns among them")->required();
  torture->add_option("--seeds", request.seeds, "N or FIRST..LAST")->default_str("1..100");
  torture->add_option("--out", request.out, "Folder for the scenarios of failed seeds")->default_str("meltbench-out");
  torture->add_option("--jobs", request.jobs, "Threads  (default: one per processor)");
  torture->footer(
      "Exit status: 0 nothing failed, 1 a seed failed, 2 bad usage or file\n"
      "Example: meltbench torture fixtures/torture/*.toml --seeds 1..10000");
}

void add_replay_command(CLI::App& app, cli::ReplayRequest& request) {
  CLI::App* replay =
      app.add_subcommand("replay", "Play a recorded log: onto a bus, to the controller, or to the boards");
  replay->add_option("log", request.log, "A log (candump, ASC, BLF, gzip), or a run's folder")->required();
  replay->add_option("--channel", request.channel, "Channel of the log  (default: that of the first frame)");
  CLI::Option* can = replay->add_option("--can", request.can,
                                        "Send all frames at their recorded times on can0, vcan0 ..., or "
                                        "slcan:PORT@BIT_RATE; with --to: only one side's, to who answers there");
  CLI::Option* to = replay->add_option(
      "--to", request.to,
      "controller | boards: play the other side to ours in virtual time, with --can to somebody else's at wall-clock "
      "pace, and compare the answers");
  const auto add_raw = [&](const char* name, auto& value, const char* text) {
    return replay->add_option(name, value, std::string{"With --can alone: "} + text)->needs(can)->excludes(to);
  };
  add_raw("--speed", request.speed, "so many times as fast")->default_str("1");
  add_raw("--loop", request.loops, "so many times; 0 = until Ctrl-C")->default_str("1");
  add_raw("--only", request.only, "ID or ID/MASK in hexadecimal; may be given several times");
  add_raw("--rename", request.renames, "OLD=NEW identifier in hexadecimal");
  replay
      ->add_option("--scenario", request.scenario, "With --to: rig and settings  (default: repro.toml beside the log)")
      ->needs(to);
  replay->add_option("--time-tolerance", request.time_tolerance_ms, "With --to: of an answer, in ms")
      ->default_str("1")
      ->needs(to);
  replay
      ->add_option("--tolerance", request.value_tolerances,
                   "With --to: BOARD.INDEX:SUB=VALUE, by how much an object in a PDO may differ; several")
      ->needs(to);
  replay->add_option("--update-reference", request.update_reference, "With --to: write what was said now to this log")
      ->needs(to)
      ->excludes(can);
  replay->add_option("--html", request.html, "With --to: write a page with the fit and plots of what differs")
      ->needs(to);
  replay->footer(
      "Exit status: 0 sent, or no answer differs, 1 an answer differs, 2 bad usage or file\n"
      "Example: meltbench replay meltbench-out --to controller");
}

/// Takes wall-clock pace, which `what` needs. @throws std::invalid_argument if the user has asked for virtual time.
void take_real_time(cli::RunRequest& run, std::string_view what) {
  if (run.pace_given && run.pace.is_virtual()) {
    throw std::invalid_argument{fmt::format("{} has no virtual time: use --pace realtime", what)};
  }
  run.pace.kind = cli::Pace::Kind::kRealTime;
}

void add_extract_command(CLI::App& app, cli::ExtractRequest& request) {
  CLI::App* extract = app.add_subcommand("extract", "Make a scenario of what went wrong on a recorded bus");
  extract->add_option("log", request.log, "A log (candump, ASC, BLF, gzip), or a run's folder")->required();
  extract->add_option("--scenario", request.scenario, "Rig and settings  (default: repro.toml beside the log)");
  extract->add_option("--channel", request.channel, "Channel of the log  (default: that of the first frame)");
  extract->add_option("--serial", request.serial,
                      "What went over serial lines meanwhile  (default: serial.log beside the log)");
  extract->add_option("-o,--out", request.out, "The scenario to write")->required();
  extract->add_flag("--minimise", request.minimise,
                    "Leave faults out as long as the controller still fails as recorded");
  extract->footer(
      "Finds what the wire, the boards or a serial line say, and, by running the machine again, sensors that drift or "
      "are\n"
      "stuck, welded relays, dead heaters and bridging feeders; says what it cannot repeat.\n"
      "Example: meltbench extract night.log --scenario fixtures/scenarios/coupled_start_up.toml -o night.toml\n"
      "         meltbench run night.toml");
}

void add_fault_command(CLI::App& app, cli::FaultRequest& request) {
  CLI::App* fault = app.add_subcommand("fault", "Let something fail in a run that goes on");
  fault
      ->add_option(
          "fault", request.words,
          "FAULT: the keys of [[fault]], with commas between them; without at_s, at_frame and when it begins at "
          "once. BENCH: name of the bus, as --can virtual:NAME gives it, or folder of the run  (default: the "
          "only one that goes on)")
      ->option_text("[BENCH] FAULT, or [BENCH] with --list and --clear");
  CLI::Option* list = fault->add_flag("--list", request.list, "Tell which faults are on or to come, and what can fail");
  fault->add_option("--clear", request.clear, "End the fault of this name; without one in FAULT it is \"TARGET KIND\"")
      ->excludes(list);
  fault->footer(
      "Exit status: 0 done, 2 refused, or no such bench, 3 the run has ended\n"
      "What can fail, and how: fixtures/scenarios/FAULTS.md\n"
      "Example: meltbench fault --list\n"
      "         meltbench fault 'target = \"sensor.melt_pressure\", kind = \"drift\", drift_Pa_per_s = 500, for_s = "
      "10'");
}

void add_record_command(CLI::App& app, cli::RecordRequest& request) {
  CLI::App* record =
      app.add_subcommand("record", "Record a bus as candump text, and serial lines beside it, until Ctrl-C");
  record
      ->add_option("bus", request.can,
                   "can0, vcan0 ..., slcan:PORT@BIT_RATE, virtual:NAME of a run at --pace realtime; none: lines only")
      ->required();
  record->add_option("--line", request.lines,
                     "NAME=PORT, e.g. feeder=/dev/ttyUSB0@19200:8E1 (the default): a serial line, to NAME.serial.log. "
                     "A port hears what it receives: between two others on RS-485 it hears both, on RS-232 a tap "
                     "adapter has a port for each. NAME alone: a line of virtual:NAME");
  record->add_option("--rig", request.rig, "The machine: named in the head, and knows the settings of its lines");
  record->add_option("--out", request.out, "File; it must not be there yet  (default: BUS-DATE_TIME.log)");
  record->add_option("--rotate-mb", request.rotate_MB, "A new file (NAME.2.log ...) before one has so many megabytes")
      ->check(CLI::Range(0.01, 1e6));
  record->add_option("--rotate-min", request.rotate_min, "A new file after so many minutes")
      ->check(CLI::Range(0.01, 1e6));
  record->footer(
      "Examples: meltbench record can0 --out night.log --rotate-min 60\n"
      "          meltbench record can0 --line feeder=/dev/ttyUSB0@115200:8E1\n"
      "          meltbench record virtual:bench --line dosing");
}

void add_show_command(CLI::App& app, cli::ShowRequest& request) {
  CLI::App* show = app.add_subcommand("show", "Tell in words what happened on a recorded bus");
  show->add_option("log", request.log, "A log (candump, ASC, BLF, gzip), or a run's folder")->required();
  show->add_option("--scenario", request.scenario, "Whose rig it is  (default: repro.toml beside the log)");
  show->add_option("--dbc", request.dbc, "Names and decodes what is not the rig's; does without a rig, too");
  show->add_option("--serial", request.serial,
                   "What went over serial lines meanwhile  (default: NAME.serial.log or serial.log beside NAME.log)");
  show->add_option("--channel", request.channel, "Channel of the log  (default: that of the first frame)");
  CLI::Option* frames = show->add_flag("--frames", request.frames, "Every frame, decoded, in place of the story");
  show->add_option("--html", request.html, "Write the story with its plots as this page, in place of text")
      ->excludes(frames);
  show->footer(
      "Example: meltbench show night.log.gz --scenario fixtures/scenarios/coupled_start_up.toml --html night.html");
}

/// Sorts what --tap says.
/// @throws std::invalid_argument for two places of one kind.
void take_taps(const std::vector<std::string>& taps, tap::TapOptions& options) {
  constexpr std::string_view kKernelPrefix = "can:";
  for (const std::string& text : taps) {
    const bool on_kernel = text.starts_with(kKernelPrefix);
    std::string& place = on_kernel ? options.kernel_bus : options.socketcand;
    if (!place.empty()) {
      throw std::invalid_argument{
          fmt::format("--tap {}: one {} is enough", text, on_kernel ? "interface" : "PORT or unix:PATH")};
    }
    place = on_kernel ? text.substr(kKernelPrefix.size()) : text;
    if (place.empty()) throw std::invalid_argument{fmt::format("--tap \"{}\" names no place, e.g. can:vcan0", text)};
  }
}

/// @throws std::invalid_argument for what cannot go together.
void settle(Words& words, const CLI::App& run) {
  words.run.pace = cli::parse_pace(words.pace);
  words.run.pace_given = words.in_process || run.count("--pace") > 0;
  take_taps(words.taps, words.run.tap);
  if (words.in_process) {
    if (!words.run.pace.is_virtual())
      throw std::invalid_argument{"--in-process runs in virtual time: drop it, or --pace"};
    if (!words.run.can.empty()) throw std::invalid_argument{"--in-process uses no bus that --can could name"};
    words.run.pace.kind = cli::Pace::Kind::kInProcess;
  }
  const auto kind = words.run.can.empty() ? link::BusUri::Kind::kVirtual : link::parse_bus_uri(words.run.can).kind;
  if (kind == link::BusUri::Kind::kNone) {
    throw std::invalid_argument{"a run has a CAN bus: none is for plant_emulator and controller started by hand"};
  }
  const bool on_kernel = kind == link::BusUri::Kind::kSocketCan;
  if (on_kernel) {
    take_real_time(words.run, "a kernel bus");
    if (words.run.tap.is_wanted()) {
      throw std::invalid_argument{
          "a kernel bus is open to every program: --tap and --slcan-pty are for an embedded one"};
    }
  }
  if (!words.run.tap.kernel_bus.empty()) take_real_time(words.run, "--tap can:");
  if (kind == link::BusUri::Kind::kSlcan) take_real_time(words.run, "a CAN adapter");
  if (!words.run.lines.empty() || !words.run.controller_lines.empty()) take_real_time(words.run, "a serial port");
  if (!words.run.tap.is_wanted() && run.count("--tap-wait") + run.count("--tap-read-only") > 0) {
    throw std::invalid_argument{"--tap-wait and --tap-read-only say how others come in by --tap or --slcan-pty"};
  }
  if (!words.run.controller_can.empty() && !on_kernel) {
    throw std::invalid_argument{"--controller-can needs a --can that is a kernel interface, too"};
  }
  if (run.count("--rt") > 0) words.run.rt_priority = words.rt_priority;
  if (run.count("--seed") > 0) words.run.seed = words.seed;
  if (words.run.out.empty()) words.run.out = "meltbench-out";
}

/// The command that the first word is; nullptr: it is none.
const CLI::App* find_command(const CLI::App& app, std::string_view word) {
  const auto commands = app.get_subcommands([](const CLI::App*) { return true; });
  const auto found = std::ranges::find(commands, word, &CLI::App::get_name);
  return found == commands.end() ? nullptr : *found;
}

/// The parser says that a command is missing where there is an unknown one.
std::string explain(const CLI::ParseError& error, const CLI::App& app, std::string_view word) {
  if (word.empty() || word.starts_with('-') || find_command(app, word) != nullptr) return error.what();
  return fmt::format("there is no command \"{}\"", word);
}

std::string name_help(const CLI::App& app, std::string_view word) {
  if (find_command(app, word) == nullptr) return "see \"meltbench --help\"";
  return fmt::format("see \"meltbench {} --help\"", word);
}

/// What to do about a file or a process that the system has refused.
std::string hint_for(const std::error_code& code) {
  if (code == std::errc::file_exists) return "it is left as it is: choose another name";
  if (code == std::errc::no_space_on_device)
    return "what was written up to then is there; make room, or choose another disk";
  return "is the path right, and may you read and write there?";
}

ExitStatus dispatch(CLI::App& app, Words& words) {
  const CLI::App* run = app.get_subcommand("run");
  if (run->parsed()) {
    settle(words, *run);
    return cli::run_scenarios(words.run);
  }
  if (app.got_subcommand("list")) {
    if (!words.scenario.empty()) return cli::list_signals(words.scenario);
    return cli::list_scenarios(words.scenarios.empty() ? cli::find_scenarios() : words.scenarios);
  }
  if (app.got_subcommand("report")) return cli::make_report(words.folders, words.page);
  if (app.got_subcommand("check")) return cli::check_again(words.folders, words.scenario);
  if (app.got_subcommand("torture")) {
    if (words.torture.out.empty()) words.torture.out = "meltbench-out";
    return cli::torture(words.torture);
  }
  if (app.got_subcommand("replay")) return cli::replay_log(words.replay);
  if (app.got_subcommand("record")) return cli::record_log(words.record);
  if (app.got_subcommand("extract")) return cli::extract_scenario(words.extract);
  if (app.got_subcommand("fault")) return cli::give_fault(words.fault);
  if (app.got_subcommand("show")) return cli::show_log(words.show);
  if (app.got_subcommand("convert")) return cli::convert_log(words.from, words.to);
  return cli::examine_machine(words.examination);
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app{"meltbench - run hardware-in-the-loop scenarios against an extruder controller"};
  app.set_version_flag("--version", std::string{cli::kProgramVersion});
  app.require_subcommand(1);
  const std::string_view word = argc < 2 ? "" : argv[1];
  Words words;
  add_run_command(app, words);
  CLI::App* list = app.add_subcommand("list", "List scenarios, or the signals of one");
  list->add_option("folder", words.scenarios, "default: fixtures/scenarios");
  list->add_option("--signals", words.scenario, "A scenario: print the signals of its runs");
  CLI::App* report = app.add_subcommand("report", "Make report.html anew from run folders");
  report->add_option("folder", words.folders, "Run folders; several are overlaid")->required();
  report->add_option("--page", words.page, "Where to write it (default: report.html in the first folder)");
  CLI::App* check = app.add_subcommand("check", "Judge recorded runs again");
  check->add_option("folder", words.folders, "Run folders")->required();
  check->add_option("--scenario", words.scenario, "Whose checks (default: each folder's repro.toml)");
  CLI::App* convert = app.add_subcommand("convert", "Write a log of a CAN bus in another format");
  convert->add_option("log", words.from, "candump text, Vector ASC or BLF, plain or gzip; - for standard input")
      ->required();
  convert
      ->add_option(
          "to", words.to,
          "NAME.log (candump text), NAME.asc, NAME.blf; .gz packs the texts; - for candump text to standard output")
      ->required();
  add_replay_command(app, words.replay);
  CLI::App* doctor = app.add_subcommand("doctor", "Say what this machine offers, and how to get what is missing");
  doctor->add_option("--rig", words.examination.rig, "A rig: compare its bit rate, look for its boards");
  doctor->add_option("--can", words.examination.can, "A kernel interface: listen for two seconds who is there");
  add_record_command(app, words.record);
  add_fault_command(app, words.fault);
  add_show_command(app, words.show);
  add_extract_command(app, words.extract);
  add_torture_command(app, words.torture);
  try {
    app.parse(argc, argv);
    return static_cast<int>(dispatch(app, words));
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    return tell(explain(error, app, word), name_help(app, word), ExitStatus::kUsage);
  } catch (const config::ConfigError& error) {
    return tell(error.what(), error.hint(), ExitStatus::kUsage);
  } catch (const link::LinkError& error) {
    return tell(error.what(), error.hint(), ExitStatus::kUsage);
  } catch (const record::LoadError& error) {
    return tell(error.what(), error.hint(), ExitStatus::kUsage);
  } catch (const log::LogError& error) {
    return tell(error.what(), error.hint(), ExitStatus::kUsage);
  } catch (const report::ReportError& error) {
    return tell(error.what(), error.hint(), ExitStatus::kUsage);
  } catch (const std::invalid_argument& error) {
    return tell(error.what(), name_help(app, word), ExitStatus::kUsage);
  } catch (const std::filesystem::filesystem_error& error) {
    return tell(fmt::format("{}: {}", error.path1().string(), error.code().message()), hint_for(error.code()),
                ExitStatus::kUsage);
  } catch (const std::system_error& error) {
    return tell(error.what(), hint_for(error.code()), ExitStatus::kUsage);
  } catch (const std::exception& error) {
    return tell(error.what(), "", ExitStatus::kLost);
  }
}
