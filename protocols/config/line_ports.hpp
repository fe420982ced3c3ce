#pragma once

#include <span>
#include <string>
#include <vector>

#include "protocols/config/rig.hpp"
#include "protocols/serial/line_port.hpp"

namespace meltbench::config {

/// Reads "NAME=PORT" for lines of a rig, e.g. "hopper=/dev/ttyUSB0" (what --line says).
/// @throws std::invalid_argument in words for the user: no such form, no such line, a line twice.
[[nodiscard]] std::vector<serial::LinePort> read_line_ports(std::span<const std::string> texts, const Rig& rig);

}  // namespace meltbench::config
