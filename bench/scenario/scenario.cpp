#include "bench/scenario/scenario.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <set>
#include <utility>

#include "protocols/config/toml.hpp"

namespace meltbench::scenario {
namespace {

using config::Array;
using config::Section;
using config::Table;
using config::Value;
using TablePtr = std::shared_ptr<const Table>;

// Tables that a scenario and a variant may lay over the rig's.
constexpr std::array<std::string_view, 6> kOverrides{"bus", "line", "plant", "controller", "board", "health"};
constexpr double kMaxDuration_s = 1e6;

void refuse_unknown_top_level(const TablePtr& tree, std::initializer_list<std::string_view> known) {
  const Section root{tree};
  root.ignore(known);
  root.finish();
}

/// Their inside is checked once they are merged.
void ignore_overrides(const Section& section) {
  for (const std::string_view key : kOverrides) section.ignore({key});
}

/// The rig under this scenario: its own file, or the tables in the scenario's file itself.
TablePtr read_rig_tree(const Section& scenario, const TablePtr& tree) {
  if (!scenario.has("rig")) {
    scenario.ignore({"rig"});
    if (tree->find("rig") == nullptr) {
      scenario.fail_here("scenario.rig is missing", "name the machine, e.g. rig = \"../rigs/bizone.toml\"");
    }
    return std::make_shared<const Table>();
  }
  const std::filesystem::path file = scenario.path("rig");
  if (tree->find("rig") != nullptr) scenario.fail("rig", "but this file has a [rig] of its own", "remove one of them");
  auto rig = config::read_toml_file(file, scenario.table().find("rig")->value.origin);
  refuse_unknown_top_level(rig, {"rig", "bus", "line", "plant", "controller", "board"});
  return rig;
}

/// Paths lose their meaning when the tree leaves its file.
void make_eds_paths_absolute(Table& tree) {
  Value* boards = tree.find_value("board");
  auto* table = boards != nullptr ? std::get_if<Table>(&boards->data) : nullptr;
  if (table == nullptr) return;
  for (const config::Entry& entry : std::vector(table->entries())) {
    auto* board = std::get_if<Table>(&table->find_value(entry.key)->data);
    Value* eds = board != nullptr ? board->find_value("eds") : nullptr;
    auto* said = eds != nullptr ? std::get_if<std::string>(&eds->data) : nullptr;
    if (said == nullptr || said->empty() || !eds->origin.file) continue;
    const auto folder = std::filesystem::path{*eds->origin.file}.parent_path();
    *said = std::filesystem::absolute(folder / *said).lexically_normal().string();
  }
}

void append_items(Table& tree, std::string_view key, const Array& items, const config::Origin& origin) {
  if (items.empty()) return;
  if (tree.find(key) == nullptr) tree.set(key, Value{Array{}, origin});
  auto* list = std::get_if<Array>(&tree.find_value(key)->data);
  if (list == nullptr) {
    throw config::ConfigError{tree.find(key)->key_origin, fmt::format("{} must be a list of tables", key),
                              fmt::format("write each as [[{}]]", key)};
  }
  list->insert(list->end(), items.begin(), items.end());
}

/// The plain tables of `from`: what lies over the rig.
Table overrides_of(const Table& from) {
  Table result;
  for (const std::string_view key : kOverrides) {
    if (const config::Entry* entry = from.find(key)) result.set(*entry);
  }
  return result;
}

const Array* list_of(const Table& from, std::string_view key) {
  const config::Entry* entry = from.find(key);
  return entry == nullptr ? nullptr : std::get_if<Array>(&entry->value.data);
}

/// The checks of the file that hold for this variant, without the key that says so.
Array checks_for(const std::vector<Section>& checks, const std::vector<std::string>& variants,
                 std::string_view variant) {
  Array result;
  for (const Section& check : checks) {
    const std::vector<std::string> only = check.texts_or_none("variants");
    for (const std::string& name : only) {
      if (std::find(variants.begin(), variants.end(), name) == variants.end()) {
        check.fail("variants", fmt::format("there is no variant \"{}\"", name),
                   variants.empty() ? "this scenario has no [[variant]]"
                                    : fmt::format("variants here: {}", fmt::join(variants, ", ")));
      }
    }
    if (check.has("variants") && std::find(only.begin(), only.end(), variant) == only.end()) continue;
    Table table = check.table();
    table.erase("variants");
    result.push_back(Value{std::move(table), check.origin()});
  }
  return result;
}

struct Variant {
  std::string name;
  std::string title;
  Table table;
};

std::vector<Variant> read_variants(const Section& root) {
  std::vector<Variant> result;
  std::set<std::string> names;
  for (const Section& section : root.sections("variant")) {
    Variant variant{.name = config::read_name(section, "name"), .title = {}, .table = section.table()};
    variant.title = section.text_or("title", variant.name);
    if (!names.insert(variant.name).second) section.fail("name", "another variant has this name");
    ignore_overrides(section);
    section.ignore({"event", "fault", "check"});
    section.finish();
    result.push_back(std::move(variant));
  }
  return result;
}

/// What [scenario] itself says, the same for all variants.
ResolvedRun read_about(const Section& scenario, const std::filesystem::path& file) {
  ResolvedRun run;
  run.file = file;
  run.name = config::read_name(scenario, "name");
  run.title = scenario.text_or("title", run.name);
  run.text = scenario.text_or("text", "");
  run.duration = scenario.duration("duration_s", config::above_up_to(0, kMaxDuration_s, "e.g. duration_s = 60"));
  run.record_period = scenario.duration_or("record_period_ms", 10, config::between(0.1, 1e6));
  run.seed = static_cast<std::uint64_t>(scenario.integer_or("seed", 1, config::at_least(0)));
  if (run.record_period > run.duration) scenario.fail("record_period_ms", "must not be longer than duration_s");
  if (scenario.has("variant")) run.variant = config::read_name(scenario, "variant");
  run.variant_title = scenario.text_or("variant_title", run.variant);
  return run;
}

/// A fault that acts before the run: the machine has been off for a night.
void start_cold_if_asked(Table& tree) {
  const Array* faults = list_of(tree, "fault");
  if (faults == nullptr) return;
  for (const Value& fault : *faults) {
    const auto* table = std::get_if<Table>(&fault.data);
    const config::Entry* kind = table != nullptr ? table->find("kind") : nullptr;
    if (kind == nullptr || kind->value != Value{std::string{"cold_start"}, {}}) continue;
    Table plant, over;
    plant.set("start", Value{std::string{"cold"}, fault.origin});
    over.set("plant", Value{std::move(plant), fault.origin});
    merge(tree, over);
  }
}

/// Puts the merged tree into the run, and reads from it what the bench needs.
ResolvedRun resolve(ResolvedRun run, Table tree) {
  make_eds_paths_absolute(tree);
  start_cold_if_asked(tree);
  run.root = Section{std::make_shared<const Table>(std::move(tree))};
  run.rig = config::read_rig(run.root);
  run.events = config::read_events(run.root, run.rig);
  for (const config::TimelineEvent& event : run.events) {
    if (event.at.since_start > run.duration) {
      event.section.fail("at_s", fmt::format("the run ends at {} s", to_s(run.duration)),
                         "move the event or lengthen scenario.duration_s");
    }
  }
  run.root.finish();
  return run;
}

}  // namespace

std::vector<ResolvedRun> load(const std::filesystem::path& file) {
  const TablePtr tree = config::read_toml_file(file);
  const Section root{tree};
  if (!root.has("scenario") && root.has("rig")) {
    root.fail("rig", "this file is a rig, not a scenario",
              fmt::format("a scenario has [scenario] with rig = \"{}\"", file.filename().string()));
  }
  root.ignore({"rig", "repro"});
  ignore_overrides(root);
  const Section about = root.section("scenario");
  const ResolvedRun common = read_about(about, file);
  const TablePtr rig = read_rig_tree(about, tree);
  const std::vector<Variant> variants = read_variants(root);
  if (!variants.empty() && about.has("variant")) about.fail("variant", "but this file has [[variant]] tables");
  const std::vector<Section> checks = root.peek_all("check");
  root.ignore({"event", "fault"});
  root.finish();

  std::vector<std::string> names;
  for (const Variant& variant : variants) names.push_back(variant.name);
  if (names.empty() && !common.variant.empty()) names.push_back(common.variant);

  Table base = *rig;
  for (const std::string_view key : {"rig", "scenario"}) {
    if (const config::Entry* entry = tree->find(key)) base.set(*entry);
  }
  merge(base, overrides_of(*tree));
  for (const std::string_view key : {"event", "fault"}) {
    if (const Array* list = list_of(*tree, key)) append_items(base, key, *list, root.origin());
  }

  if (variants.empty()) {
    append_items(base, "check", checks_for(checks, names, common.variant), root.origin());
    std::vector<ResolvedRun> runs;
    runs.push_back(resolve(common, std::move(base)));
    return runs;
  }
  std::vector<ResolvedRun> runs;
  for (const Variant& variant : variants) {
    Table merged = base;
    merge(merged, overrides_of(variant.table));
    append_items(merged, "check", checks_for(checks, names, variant.name), root.origin());
    for (const std::string_view key : {"event", "fault", "check"}) {
      if (const Array* list = list_of(variant.table, key)) append_items(merged, key, *list, variant.table.origin);
    }
    ResolvedRun run = common;
    run.variant = variant.name;
    run.variant_title = variant.title;
    runs.push_back(resolve(std::move(run), std::move(merged)));
  }
  return runs;
}

ResolvedRun extend(const ResolvedRun& run, const Array& events, const Array& faults) {
  Table tree = run.root.table();
  append_items(tree, "event", events, run.root.origin());
  append_items(tree, "fault", faults, run.root.origin());
  return resolve(run, std::move(tree));
}

ResolvedRun rebuild(const ResolvedRun& run, Table tree, Nanos duration) {
  ResolvedRun again = run;
  again.duration = duration;
  return resolve(std::move(again), std::move(tree));
}

std::string write_repro(const ResolvedRun& run, std::string_view program) {
  Table about;
  const auto set = [&about](std::string_view key, auto value) { about.set(key, Value{std::move(value), {}}); };
  set("name", run.name);
  set("title", run.title);
  if (!run.variant.empty()) {
    set("variant", run.variant);
    set("variant_title", run.variant_title);
  }
  if (!run.text.empty()) set("text", run.text);
  set("duration_s", to_s(run.duration));
  set("record_period_ms", to_s(run.record_period) * 1e3);
  set("seed", static_cast<std::int64_t>(run.seed));

  Table repro;
  repro.set("program", Value{std::string{program}, {}});
  Table tree;
  tree.set("repro", Value{std::move(repro), {}});
  tree.set("scenario", Value{std::move(about), {}});
  for (const config::Entry& entry : run.root.table().entries()) {
    if (entry.key != "scenario" && entry.key != "repro") tree.set(entry);
  }
  return fmt::format("# Everything needed to repeat this run from anywhere: meltbench run FILE\n\n{}",
                     config::write_toml(tree));
}

}  // namespace meltbench::scenario
