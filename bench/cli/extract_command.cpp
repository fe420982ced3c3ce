#include "bench/cli/extract_command.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <fstream>
#include <stdexcept>
#include <system_error>

#include "bench/cli/log_commands.hpp"
#include "bench/cli/recorded_log.hpp"
#include "bench/decode/extraction.hpp"
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

}  // namespace

ExitStatus extract_scenario(const ExtractRequest& request) {
  const std::filesystem::path path = find_log(request.log);
  const scenario::ResolvedRun run = load_run_of(request.scenario, path);
  ChannelLog log{path, request.channel};
  decode::Story story{run.rig};
  log::LogEntry entry;
  while (log.next(entry)) story.take(entry.at, entry.frame);
  story.finish();
  print_log_warnings(log.reader(), path);

  decode::Extraction found = decode::extract(story.findings(), story.end(), run.rig);
  for (const std::string& note : found.notes) fmt::print("not in the scenario: {}\n", note);
  fmt::print("{} fault{}, {} check{}: {}\n", found.faults.size(), found.faults.size() == 1 ? "" : "s",
             found.checks.size(), found.checks.size() == 1 ? "" : "s", request.out.string());
  std::string text = fmt::format("# Made by \"meltbench extract\" of {}\n", path.filename().string());
  for (const std::string& note : found.notes) text += fmt::format("# not in here: {}\n", note);
  text += '\n';
  text += config::write_toml(make_scenario(run, request, std::move(found), story.end()));
  std::ofstream file{request.out};
  if (!(file << text) || !file.flush()) {
    throw std::system_error{errno, std::generic_category(), request.out.string()};
  }
  return ExitStatus::kHeld;
}

}  // namespace meltbench::cli
