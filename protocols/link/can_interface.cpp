#include "protocols/link/can_interface.hpp"

#include <linux/can/netlink.h>
#include <linux/if.h>
#include <linux/if_arp.h>
#include <linux/if_link.h>
#include <linux/rtnetlink.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cstring>

#include "protocols/link/unique_fd.hpp"

namespace meltbench::link {
namespace {

using Bytes = std::span<const std::uint8_t>;

/// A structure of the kernel out of bytes; nothing if there are too few of them.
template <typename T>
std::optional<T> load(Bytes bytes) {
  if (bytes.size() < sizeof(T)) return std::nullopt;
  T value;
  std::memcpy(&value, bytes.data(), sizeof value);
  return value;
}

/// Hands type and content of each attribute to `take`.
template <typename Take>
void for_each_attribute(Bytes bytes, Take take) {
  while (const auto header = load<rtattr>(bytes)) {
    if (header->rta_len < sizeof(rtattr) || header->rta_len > bytes.size()) return;
    take(static_cast<unsigned>(header->rta_type & NLA_TYPE_MASK),
         bytes.subspan(RTA_LENGTH(0), header->rta_len - RTA_LENGTH(0)));
    const std::size_t step = RTA_ALIGN(header->rta_len);
    if (step >= bytes.size()) return;
    bytes = bytes.subspan(step);
  }
}

std::string to_text(Bytes bytes) {
  const char* const first = reinterpret_cast<const char*>(bytes.data());
  return std::string{first, ::strnlen(first, bytes.size())};
}

std::string_view name_of_state(std::uint32_t state) {
  constexpr std::array<std::string_view, CAN_STATE_MAX> kNames{"error-active", "error-warning", "error-passive",
                                                               "bus-off",      "stopped",       "sleeping"};
  return state < kNames.size() ? kNames.at(state) : "unknown";
}

void take_can_data(CanInterface& interface, unsigned type, Bytes content) {
  switch (type) {
    case IFLA_CAN_BITTIMING:
      if (const auto timing = load<can_bittiming>(content); timing && timing->bitrate > 0) {
        interface.bit_rate_bit_per_s = timing->bitrate;
        interface.sample_point_permille = timing->sample_point;
      }
      break;
    case IFLA_CAN_DATA_BITTIMING:
      if (const auto timing = load<can_bittiming>(content); timing && timing->bitrate > 0) {
        interface.data_bit_rate_bit_per_s = timing->bitrate;
      }
      break;
    case IFLA_CAN_STATE:
      if (const auto state = load<std::uint32_t>(content)) interface.state = name_of_state(*state);
      break;
    case IFLA_CAN_RESTART_MS:
      interface.restart_ms = load<std::uint32_t>(content);
      break;
    case IFLA_CAN_TERMINATION:
      interface.termination_ohm = load<std::uint16_t>(content);
      break;
    case IFLA_CAN_BERR_COUNTER:
      if (const auto counter = load<can_berr_counter>(content)) {
        interface.tx_errors = counter->txerr;
        interface.rx_errors = counter->rxerr;
      }
      break;
    default:
      break;
  }
}

void take_link_info(CanInterface& interface, Bytes content) {
  for_each_attribute(content, [&](unsigned type, Bytes inside) {
    if (type == IFLA_INFO_KIND) interface.kind = to_text(inside);
    if (type == IFLA_INFO_DATA) {
      for_each_attribute(inside, [&](unsigned kind, Bytes data) { take_can_data(interface, kind, data); });
    }
    if (type != IFLA_INFO_XSTATS) return;
    if (const auto statistics = load<can_device_stats>(inside)) {
      interface.bus_errors = statistics->bus_error;
      interface.bus_offs = statistics->bus_off;
    }
  });
}

CanInterface read_link(const ifinfomsg& link, Bytes attributes) {
  CanInterface interface;
  interface.is_up = (link.ifi_flags & IFF_UP) != 0;
  for_each_attribute(attributes, [&](unsigned type, Bytes content) {
    if (type == IFLA_IFNAME) interface.name = to_text(content);
    if (type == IFLA_TXQLEN) interface.queue_length = load<std::uint32_t>(content).value_or(0);
    if (type == IFLA_LINKINFO) take_link_info(interface, content);
    if (type != IFLA_STATS64) return;
    rtnl_link_stats64 statistics{};  // Its size grows with the kernel's version.
    std::memcpy(&statistics, content.data(), std::min(content.size(), sizeof statistics));
    interface.rx_frames = statistics.rx_packets;
    interface.tx_frames = statistics.tx_packets;
    interface.rx_dropped = statistics.rx_dropped;
    interface.tx_dropped = statistics.tx_dropped;
  });
  return interface;
}

}  // namespace

std::vector<CanInterface> parse_can_interfaces(std::span<const std::uint8_t> messages) {
  std::vector<CanInterface> interfaces;
  while (const auto header = load<nlmsghdr>(messages)) {
    if (header->nlmsg_len < NLMSG_HDRLEN || header->nlmsg_len > messages.size()) break;
    const Bytes body = messages.subspan(NLMSG_HDRLEN, header->nlmsg_len - NLMSG_HDRLEN);
    const auto link = load<ifinfomsg>(body);
    if (header->nlmsg_type == RTM_NEWLINK && link && link->ifi_type == ARPHRD_CAN) {
      const std::size_t start = std::min<std::size_t>(NLMSG_ALIGN(sizeof(ifinfomsg)), body.size());
      interfaces.push_back(read_link(*link, body.subspan(start)));
    }
    const std::size_t step = NLMSG_ALIGN(header->nlmsg_len);
    if (step >= messages.size()) break;
    messages = messages.subspan(step);
  }
  return interfaces;
}

std::vector<CanInterface> list_can_interfaces() {
  const UniqueFd socket{::socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE)};
  struct {
    nlmsghdr header;
    ifinfomsg link;
  } request{};
  request.header.nlmsg_len = sizeof request;
  request.header.nlmsg_type = RTM_GETLINK;
  request.header.nlmsg_flags = NLM_F_REQUEST | NLM_F_DUMP;
  if (!socket || ::send(socket.get(), &request, sizeof request, 0) < 0) return {};
  std::vector<CanInterface> interfaces;
  std::vector<std::uint8_t> buffer(64 * 1024);
  while (true) {
    const ssize_t size = ::recv(socket.get(), buffer.data(), buffer.size(), 0);
    if (size < static_cast<ssize_t>(sizeof(nlmsghdr))) return interfaces;
    const std::span part{buffer.data(), static_cast<std::size_t>(size)};
    const auto header = load<nlmsghdr>(part);
    if (header->nlmsg_type == NLMSG_DONE || header->nlmsg_type == NLMSG_ERROR) return interfaces;
    for (CanInterface& interface : parse_can_interfaces(part)) interfaces.push_back(std::move(interface));
  }
}

}  // namespace meltbench::link
