#include "bench/cli/extract_command.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <system_error>

#include "bench/cli/diagnosis.hpp"
#include "bench/cli/log_commands.hpp"
#include "bench/cli/minimise.hpp"
#include "bench/cli/recorded_log.hpp"
#include "bench/decode/line_trouble.hpp"
#include "protocols/config/toml.hpp"

namespace meltbench::cli {
namespace {

using config::Array;
using config::Table;
using config::Value;

template <typename T>
void set(Table& table, std::string_view key, T value) {
  table.set(key, Value{std::move(value), {}});
}

Array to_array(std::vector<Table> tables) {
  Array array;
  for (Table& table : tables) array.push_back(Value{std::move(table), {}});
  return array;
}

/// Where the rig of a scenario file is, as seen from the folder of the new one.
std::string rig_seen_from(const std::filesystem::path& out, const std::filesystem::path& scenario,
                          const std::string& rig) {
  const auto file = std::filesystem::weakly_canonical(std::filesystem::absolute(scenario).parent_path() / rig);
  return file.lexically_relative(std::filesystem::weakly_canonical(std::filesystem::absolute(out)).parent_path())
      .string();
}

/// [scenario]: that of the settings, with a new name and as long as the log.
Table make_head(const scenario::ResolvedRun& run, const Table& settings, const ExtractRequest& request, Instant end) {
  Table head;
  set(head, "name", request.out.stem().string());
  set(head, "title", fmt::format("What happened in {}", request.log.filename().string()));
  if (const config::Entry* old = settings.find("scenario")) {
    const auto* table = std::get_if<Table>(&old->value.data);
    const config::Entry* rig = table == nullptr ? nullptr : table->find("rig");
    if (rig != nullptr) {
      set(head, "rig", rig_seen_from(request.out, run.file, std::get<std::string>(rig->value.data)));
    }
  }
  set(head, "duration_s", std::ceil(to_s(end) * 100.0) / 100.0);
  set(head, "record_period_ms", to_s(run.record_period) * 1e3);
  set(head, "seed", static_cast<std::int64_t>(run.seed));
  return head;
}

/// Everything of the settings but what the log replaces; events after its end cannot happen.
Table make_scenario(const scenario::ResolvedRun& run, const ExtractRequest& request, decode::Extraction found,
                    Instant end) {
  const Table settings = *config::read_toml_file(run.file);
  Table tree;
  set(tree, "scenario", make_head(run, settings, request, end));
  constexpr std::array<std::string_view, 6> kReplaced{"scenario", "check", "fault", "variant", "health", "repro"};
  for (const config::Entry& entry : settings.entries()) {
    if (std::ranges::find(kReplaced, entry.key) == kReplaced.end() && entry.key != "event") tree.set(entry);
  }
  if (Table bus = make_bus(found, run.rig.bus); !bus.empty()) {
    Table over;
    set(over, "bus", std::move(bus));
    merge(tree, over);
  }
  Array events;
  for (const config::TimelineEvent& event : run.events) {
    if (event.at < end) events.push_back(Value{event.section.table(), {}});
  }
  if (!events.empty()) set(tree, "event", std::move(events));
  if (!found.faults.empty()) set(tree, "fault", to_array(std::move(found.faults)));
  set(tree, "check", to_array(std::move(found.checks)));
  Array expect;
  for (std::string& code : found.expect) expect.push_back(Value{std::move(code), {}});
  Table health;
  set(health, "expect", std::move(expect));
  set(tree, "health", std::move(health));
  return tree;
}

/// What went over the serial lines of the rig meanwhile.
std::vector<decode::LineReport> read_lines(const ExtractRequest& request, const std::filesystem::path& log,
                                           const config::Rig& rig, Instant zero) {
  const std::filesystem::path path = request.serial.empty() ? find_serial_log(log) : request.serial;
  if (rig.lines.empty() || path.empty()) return {};
  decode::LineListener listener{rig};
  read_serial_log(path, zero, [&](Instant at, const log::SerialEntry& entry) {
    listener.take(at, entry.line, entry.sender, entry.bytes);
  });
  return listener.finish();
}

/// What a recording becomes.
class Maker {
 public:
  Maker(const ExtractRequest& request, std::filesystem::path log)
      : request_{request}, path_{std::move(log)}, run_{load_run_of(request.scenario, path_)}, traces_{run_.rig} {}

  ExitStatus make() {
    read();
    loop_.emplace(run_, end_);
    if (end_ > Instant{}) loop_->take_bus(found_);
    leave_out_unknown();
    if (loop_->is_possible()) {
      look_for_silent_faults();
      name_babbler();
      move_second_node();
      if (request_.minimise) leave_out_needless();
      compare();
    } else if (request_.minimise) {
      throw std::invalid_argument{"--minimise runs the machine in memory: nothing of it may be real or external"};
    }
    if (found_.is_unexplained) {
      found_.notes.push_back(fmt::format("{:.6f} s: why the controller went to its safe state", to_s(*safe_at())));
    }
    write();
    return ExitStatus::kHeld;
  }

 private:
  void read() {
    ChannelLog log{path_, request_.channel};
    decode::Story story{run_.rig};
    log::LogEntry entry;
    while (log.next(entry)) {
      story.take(entry.at, entry.frame);
      traces_.take(entry.at, entry.frame);
    }
    story.finish();
    print_log_warnings(log.reader(), path_);
    end_ = story.end();
    found_ = decode::extract(story.findings(), end_, run_.rig);
    const std::vector<decode::LineReport> lines = read_lines(request_, path_, run_.rig, log.zero());
    for (const decode::LineReport& line : lines) {
      if (line.garbled == 0) continue;
      fmt::print("line {}: {} pieces garbled, as {:.2g} % wrong bytes would\n", line.line, line.garbled,
                 line.byte_share * 100.0);
    }
    decode::add_line_faults(found_, lines, end_);
  }

  /// What this program has no fault for, or this machine.
  void leave_out_unknown() {
    std::erase_if(found_.faults, [&](const Table& fault) {
      if (loop_->knows(fault)) return false;
      found_.notes.push_back(fmt::format("{}: there is no such fault", describe_fault(fault)));
      return true;
    });
  }

  [[nodiscard]] std::optional<Instant> safe_at() const {
    const auto found = std::ranges::find(found_.reactions, decode::Reaction::Kind::kSafeState, &decode::Reaction::kind);
    return found == found_.reactions.end() ? std::nullopt : std::optional{found->at};
  }

  /// An EMCY that the bus does not explain is sent as such; better if what caused it is found.
  void look_for_silent_faults() {
    std::vector<Table> told = found_.faults;
    std::erase_if(told, [](const Table& fault) {
      return fault.find("kind")->value == Value{std::string{"emcy_storm"}, {}};
    });
    Diagnosis diagnosis;
    if (told.size() < found_.faults.size()) diagnosis = diagnose(*loop_, traces_, told, safe_at());
    if (diagnosis.fault) {
      told.push_back(*diagnosis.fault);
      if (!difference(told).empty()) diagnosis.fault.reset();
    }
    if (!diagnosis.fault) {
      diagnosis = diagnose(*loop_, traces_, found_.faults, safe_at());
      told = found_.faults;
      if (diagnosis.fault) told.push_back(*diagnosis.fault);
    }
    if (!diagnosis.text.empty() && !diagnosis.fault) found_.notes.push_back(std::move(diagnosis.text));
    if (!diagnosis.fault) return;
    fmt::print("{}\n", diagnosis.text);
    found_.faults = std::move(told);
    found_.checks.push_back(std::move(*diagnosis.check));
    found_.is_unexplained = false;
  }

  [[nodiscard]] std::string difference(const std::vector<Table>& faults) {
    return decode::describe_difference(found_.reactions, loop_->run(faults).reactions, run_.rig);
  }

  /// Frames do not say who sends them: of all boards the one with which the reactions are the same.
  void name_babbler() {
    const auto babbles = [](const Table& fault) {
      return fault.find("kind")->value == Value{std::string{"babble"}, {}};
    };
    const auto found = std::ranges::find_if(found_.faults, babbles);
    if (found == found_.faults.end() || difference(found_.faults).empty()) return;
    std::vector<Table> faults = found_.faults;
    Table& fault = faults[static_cast<std::size_t>(found - found_.faults.begin())];
    for (const config::RigBoard& board : run_.rig.boards) {
      if (board.is_on_line()) continue;
      set(fault, "target", "bus." + board.name);
      if (!difference(faults).empty()) continue;
      found_.faults = std::move(faults);
      return;
    }
  }

  /// When a second device is noticed depends on how its heartbeats lie between those of the first. Where both start in
  /// another time than in the log, it has to come a heartbeat or two sooner or later.
  void move_second_node() {
    constexpr Nanos kMost = 200ms;
    const auto doubles = [](const Table& fault) { return fault.find("running") != nullptr; };
    const auto found = std::ranges::find_if(found_.faults, doubles);
    if (found == found_.faults.end() || !safe_at()) return;
    const ClosedLoopResult again = loop_->run(found_.faults);
    const auto safe = std::ranges::find(again.reactions, decode::Reaction::Kind::kSafeState, &decode::Reaction::kind);
    if (safe == again.reactions.end()) return;
    const Nanos late = safe->at - *safe_at();
    if (std::chrono::abs(late) <= decode::kReactionTolerance || std::chrono::abs(late) > kMost) return;
    std::vector<Table> faults = found_.faults;
    Table& fault = faults[static_cast<std::size_t>(found - found_.faults.begin())];
    const double at_s = std::get<double>(fault.find("at_s")->value.data);
    set(fault, "at_s", std::round((at_s - to_s(late)) * 1e6) / 1e6);
    if (difference(faults).empty()) found_.faults = std::move(faults);
  }

  /// What must still show: the controller's safe state, or, without one, all that the log shows.
  [[nodiscard]] std::vector<decode::Reaction> failure(std::span<const decode::Reaction> reactions) const {
    std::vector<decode::Reaction> kept{reactions.begin(), reactions.end()};
    if (safe_at()) {
      std::erase_if(kept, [](const auto& reaction) { return reaction.kind != decode::Reaction::Kind::kSafeState; });
    }
    return kept;
  }

  void leave_out_needless() {
    const std::vector<decode::Reaction> wanted = failure(found_.reactions);
    const auto still_fails = [&](const std::vector<Table>& faults) {
      return decode::describe_difference(wanted, failure(loop_->run(faults).reactions), run_.rig).empty();
    };
    if (wanted.empty() || !still_fails(found_.faults)) {
      fmt::print("not minimised: {}\n", wanted.empty() ? "the log shows no reaction that could be lost"
                                                       : "the faults do not repeat the failure");
      return;
    }
    Minimised least = minimise(std::move(found_.faults), still_fails);
    for (const Table& fault : least.dropped) fmt::print("needless: {}\n", describe_fault(fault));
    for (const Table& fault : least.shortened) fmt::print("shorter than: {}\n", describe_fault(fault));
    fmt::print("{} of {} faults are left after {} runs\n", least.faults.size(),
               least.faults.size() + least.dropped.size(), least.runs);
    found_.faults = std::move(least.faults);
    found_.reactions = decode::find_repeated(found_.reactions, loop_->run(found_.faults).reactions);
    found_.checks = decode::make_checks(found_.reactions, run_.rig, decode::style_of(found_));
  }

  /// Says whether the scenario will do what the log shows, and lists what its health gate has to expect.
  void compare() {
    const ClosedLoopResult again = loop_->run(found_.faults);
    const std::string different = decode::describe_difference(found_.reactions, again.reactions, run_.rig);
    const std::size_t count = found_.reactions.size();
    if (!different.empty()) {
      fmt::print("run closed loop: {}\n", different);
    } else {
      fmt::print("run closed loop: the same {} reaction{}, each within {} ms\n", count, count == 1 ? "" : "s",
                 decode::kReactionTolerance / 1ms);
    }
    found_.expect.insert(found_.expect.end(), again.complaints.begin(), again.complaints.end());
    std::ranges::sort(found_.expect);
    found_.expect.erase(std::unique(found_.expect.begin(), found_.expect.end()), found_.expect.end());
  }

  void write() {
    for (const std::string& note : found_.notes) fmt::print("not in the scenario: {}\n", note);
    fmt::print("{} fault{}, {} check{}: {}\n", found_.faults.size(), found_.faults.size() == 1 ? "" : "s",
               found_.checks.size(), found_.checks.size() == 1 ? "" : "s", request_.out.string());
    std::string text = fmt::format("# Made by \"meltbench extract\" of {}\n", path_.filename().string());
    for (const std::string& note : found_.notes) text += fmt::format("# not in here: {}\n", note);
    text += '\n';
    text += config::write_toml(make_scenario(run_, request_, std::move(found_), end_));
    std::ofstream file{request_.out};
    if (!(file << text) || !file.flush()) {
      throw std::system_error{errno, std::generic_category(), request_.out.string()};
    }
  }

  const ExtractRequest& request_;
  std::filesystem::path path_;
  scenario::ResolvedRun run_;
  decode::Traces traces_;
  Instant end_{};
  decode::Extraction found_;
  std::optional<ClosedLoop> loop_;
};

}  // namespace

ExitStatus extract_scenario(const ExtractRequest& request) {
  return Maker{request, find_log(request.log)}.make();
}

}  // namespace meltbench::cli
