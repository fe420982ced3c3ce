#pragma once
/// What a reader complains about, as one text: "place: message | hint". Empty if it does not complain.

#include <memory>
#include <string>
#include <string_view>

#include "protocols/config/section.hpp"
#include "protocols/config/toml.hpp"

namespace meltbench::config {

template <typename Action>
std::string complaint_of(Action&& action) {
  try {
    action();
  } catch (const ConfigError& error) {
    return std::string{error.what()} + (error.hint().empty() ? "" : " | " + error.hint());
  }
  return {};
}

inline Section section_of(std::string_view toml) {
  return Section{std::make_shared<const Table>(parse_toml(toml, "a.toml"))};
}

}  // namespace meltbench::config
