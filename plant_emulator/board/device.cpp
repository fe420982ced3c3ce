#include "plant_emulator/board/device.hpp"

#include <fmt/format.h>

namespace meltbench::board {

void Device::report(Severity severity, Instant at, std::string code, std::string_view text) {
  events_.push_back({at, severity, std::move(code), fmt::format("{}: {}", name_, text)});
}

}  // namespace meltbench::board
