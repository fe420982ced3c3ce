#pragma once
/// Emulators made from the text of a rig, for the tests.

#include <catch2/catch.hpp>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "plant_emulator/emulator.hpp"
#include "protocols/config/rig.hpp"
#include "protocols/config/toml.hpp"

namespace meltbench::emulator::testing {

inline EmulatorSettings read(const std::string& text) {
  const config::Section root{std::make_shared<config::Table>(config::parse_toml(text, "rig.toml"))};
  const config::Rig rig = config::read_rig(root);
  EmulatorSettings settings = read_settings(root, rig);
  root.ignore({"controller"});
  root.finish();
  return settings;
}

/// What a ConfigError says about this rig, with its hint.
inline std::string complaint(const std::string& text) {
  try {
    static_cast<void>(read(text));
  } catch (const config::ConfigError& error) {
    return std::string{error.what()} + "\n" + error.hint();
  }
  return "none";
}

inline double read_signal(const Emulator& emulator, std::string_view name) {
  std::vector<double> values(emulator.signals().size());
  emulator.read_signals(values);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (emulator.signals()[i].name == name) return values[i];
  }
  FAIL("the emulator has no signal " << name);
  return 0;
}

}  // namespace meltbench::emulator::testing
