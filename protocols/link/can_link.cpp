#include "protocols/link/can_link.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

#include "protocols/link/no_can_link.hpp"
#include "protocols/link/slcan_link.hpp"
#include "protocols/link/socketcan_link.hpp"

namespace meltbench::link {
namespace {

constexpr std::string_view kSlcan = "slcan:";
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

[[noreturn]] void refuse(std::string_view text) {
  throw LinkError{fmt::format("\"{}\" is no CAN bus", text),
                  "a bus is virtual:NAME, a kernel interface such as can0, vcan0 or socketcan:can0, an adapter such as "
                  "slcan:/dev/ttyACM0@500000, or none; a name has at most 15 letters, digits, '_', '-' or '.'"};
}

BusUri parse_slcan_uri(std::string_view text) {
  const std::string_view words = text.substr(kSlcan.size());
  const std::size_t at = words.rfind('@');
  BusUri uri{BusUri::Kind::kSlcan, std::string{words.substr(0, at)}};
  if (uri.name.empty()) refuse(text);
  if (at == std::string_view::npos) return uri;
  const std::string_view rate = words.substr(at + 1);
  const auto [end, error] = std::from_chars(rate.data(), rate.data() + rate.size(), uri.bit_rate_bit_per_s);
  if (error != std::errc{} || end != rate.data() + rate.size()) refuse(text);
  return uri;
}

}  // namespace

BusUri parse_bus_uri(std::string_view text) {
  if (text == "none") return {BusUri::Kind::kNone, {}};
  if (text.starts_with(kSlcan)) return parse_slcan_uri(text);
  BusUri uri{BusUri::Kind::kSocketCan, std::string{text}};
  if (text.starts_with("virtual:")) {
    uri = {BusUri::Kind::kVirtual, std::string{text.substr(8)}};
  } else if (text.starts_with("socketcan:")) {
    uri.name = text.substr(10);
  }
  if (!is_plain_name(uri.name)) refuse(text);
  return uri;
}

std::unique_ptr<CanLink> open_can_link(const BusUri& uri) {
  switch (uri.kind) {
    case BusUri::Kind::kSlcan:
      return std::make_unique<SlcanLink>(uri.name, uri.bit_rate_bit_per_s);
    case BusUri::Kind::kNone:
      return std::make_unique<NoCanLink>();
    case BusUri::Kind::kSocketCan:
    case BusUri::Kind::kVirtual:
      break;
  }
  return std::make_unique<SocketCanLink>(uri.name);
}

}  // namespace meltbench::link
