#include "protocols/config/line_ports.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

namespace meltbench::config {
namespace {

[[noreturn]] void refuse_line(std::string_view name, const Rig& rig) {
  std::vector<std::string> names;
  for (const RigLine& line : rig.lines) names.push_back(line.name);
  throw std::invalid_argument{
      rig.lines.empty() ? fmt::format("this rig has no serial lines, so none named \"{}\"", name)
                        : fmt::format("\"{}\" is no line of this rig; it has {}", name, fmt::join(names, ", "))};
}

}  // namespace

std::vector<serial::LinePort> read_line_ports(std::span<const std::string> texts, const Rig& rig) {
  std::vector<serial::LinePort> ports;
  for (const std::string& text : texts) {
    const std::size_t equals = text.find('=');
    if (equals == 0 || equals == std::string::npos || equals + 1 == text.size()) {
      throw std::invalid_argument{
          fmt::format("a serial line's port is LINE=PORT, e.g. hopper=/dev/ttyUSB0, not \"{}\"", text)};
    }
    const std::string name = text.substr(0, equals);
    const auto line =
        std::find_if(rig.lines.begin(), rig.lines.end(), [&](const RigLine& one) { return one.name == name; });
    if (line == rig.lines.end()) refuse_line(name, rig);
    if (std::any_of(ports.begin(), ports.end(), [&](const auto& port) { return port.line == name; })) {
      throw std::invalid_argument{fmt::format("the port of serial line {} is given twice", name)};
    }
    ports.push_back({name, text.substr(equals + 1), line->settings});
  }
  return ports;
}

}  // namespace meltbench::config
