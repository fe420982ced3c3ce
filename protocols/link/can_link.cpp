#include "protocols/link/can_link.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace meltbench::link {
namespace {

constexpr std::size_t kMaxInterfaceName = 15;  // IFNAMSIZ - 1, and what candump logs can hold.

bool is_plain_name(std::string_view name) {
  return !name.empty() && name.size() <= kMaxInterfaceName &&
         std::ranges::all_of(name,
                             [](char c) {
                               return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
                                      c == '_' || c == '-' || c == '.';
                             }) &&
         name.front() != '.' && name.front() != '-';
}

}  // namespace

BusUri parse_bus_uri(std::string_view text) {
  BusUri uri{BusUri::Kind::kSocketCan, std::string{text}};
  if (text.starts_with("virtual:")) {
    uri = {BusUri::Kind::kVirtual, std::string{text.substr(8)}};
  } else if (text.starts_with("socketcan:")) {
    uri.name = text.substr(10);
  }
  if (!is_plain_name(uri.name)) {
    throw LinkError{fmt::format("\"{}\" is no CAN bus", text),
                    "a bus is virtual:NAME, or a kernel interface such as can0, vcan0 or socketcan:can0; "
                    "a name has at most 15 letters, digits, '_', '-' or '.'"};
  }
  return uri;
}

}  // namespace meltbench::link
