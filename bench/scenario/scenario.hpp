#pragma once
/// Scenario files: what happens to a rig. One file can hold several variants, each of which is a run of its own.
///
///   [scenario]  name, title, text, rig = "../rigs/bizone.toml" (or the rig's tables in this same file), duration_s,
///               record_period_ms (default 10), seed (default 1)
///   [bus] [plant] [controller] [board.NAME] [health]     keys that replace those of the rig, key by key
///   [[event]]   at_s, target, action, and what the action needs
///   [[fault]]   what fails, when and for how long, read by protocols/fault
///   [[check]]   what must hold, read by bench/check; variants = ["a", "b"] restricts it to some variants
///   [[variant]] name, title, and any of the tables above for this variant only; its events, faults and checks are
///   added

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "protocols/config/rig.hpp"
#include "protocols/config/section.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::scenario {

/// One run, with everything merged: scenario over rig, variant over both.
struct ResolvedRun {
  std::string name;           ///< scenario.name; can be a folder name.
  std::string variant;        ///< Name of the variant; empty if the scenario has none.
  std::string title;          ///< scenario.title, the name if not given.
  std::string variant_title;  ///< The variant's title, its name if not given.
  std::string text;           ///< scenario.text: what this run shows; may be empty.
  std::filesystem::path file;
  Nanos duration{};
  Nanos record_period{};
  std::uint64_t seed = 1;
  config::Rig rig;
  std::vector<config::TimelineEvent> events;  ///< All targets, in the order of time.
  config::Section root;                       ///< The merged tree: root.section("plant"), root.sections("check") ...

  /// "name" or "name.variant": names a run in messages and folders.
  [[nodiscard]] std::string label() const { return variant.empty() ? name : name + "." + variant; }
};

/// Reads a scenario, its rig and its variants, strictly: what the bench itself reads is checked here, including that
/// every top-level table is known; the inside of [plant], [controller], [board.NAME], [[check]] and [health] is checked
/// by whoever reads it. EDS paths in the tree are absolute.
/// @returns one run per [[variant]] in the order of the file, or exactly one.
/// @throws config::ConfigError
[[nodiscard]] std::vector<ResolvedRun> load(const std::filesystem::path& file);

/// The same run with these events and faults added, as if its file had them.
/// @throws config::ConfigError
[[nodiscard]] ResolvedRun extend(const ResolvedRun& run, const config::Array& events, const config::Array& faults);

/// The same run with another merged tree in place of its own, and lasting so long.
/// @throws config::ConfigError
[[nodiscard]] ResolvedRun rebuild(const ResolvedRun& run, config::Table tree, Nanos duration);

/// The TOML text that repeats this run from anywhere: load() accepts it and gives one equal run, and it is the file
/// that the emulator and the controller get.
/// @param program  e.g. "meltbench 0.1.0", kept in [repro].
[[nodiscard]] std::string write_repro(const ResolvedRun& run, std::string_view program);

}  // namespace meltbench::scenario
