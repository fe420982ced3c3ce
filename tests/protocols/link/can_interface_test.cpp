#include "protocols/link/can_interface.hpp"

#include <linux/can/netlink.h>
#include <linux/if.h>
#include <linux/if_arp.h>
#include <linux/if_link.h>
#include <linux/rtnetlink.h>

#include <catch2/catch.hpp>
#include <cstring>

using namespace meltbench::link;

namespace {

using Bytes = std::vector<std::uint8_t>;

template <typename T>
Bytes to_bytes(const T& value) {
  Bytes bytes(sizeof value);
  std::memcpy(bytes.data(), &value, sizeof value);
  return bytes;
}

Bytes join(std::initializer_list<Bytes> parts) {
  Bytes all;
  for (const Bytes& part : parts) all.insert(all.end(), part.begin(), part.end());
  return all;
}

Bytes attribute(int type, Bytes content) {
  Bytes bytes = join(
      {to_bytes(rtattr{static_cast<unsigned short>(RTA_LENGTH(content.size())), static_cast<unsigned short>(type)}),
       content});
  bytes.resize(RTA_ALIGN(bytes.size()));
  return bytes;
}

Bytes text(const char* value) {
  return Bytes(value, value + std::strlen(value) + 1);
}

Bytes link_message(unsigned short hardware, unsigned flags, const Bytes& attributes) {
  ifinfomsg link{};
  link.ifi_type = hardware;
  link.ifi_flags = flags;
  const Bytes body = join({to_bytes(link), attributes});
  nlmsghdr header{};
  header.nlmsg_type = RTM_NEWLINK;
  header.nlmsg_len = static_cast<std::uint32_t>(NLMSG_LENGTH(body.size()));
  Bytes message = join({to_bytes(header), body});
  message.resize(NLMSG_ALIGN(message.size()));
  return message;
}

/// An adapter at 500 kbit/s whose frames nobody acknowledges.
Bytes make_lonely_adapter() {
  can_bittiming timing{};
  timing.bitrate = 500'000;
  timing.sample_point = 875;
  can_device_stats statistics{};
  statistics.bus_error = 17;
  statistics.bus_off = 2;
  rtnl_link_stats64 traffic{};
  traffic.tx_packets = 5;
  const Bytes data = join({attribute(IFLA_CAN_BITTIMING, to_bytes(timing)),
                           attribute(IFLA_CAN_STATE, to_bytes(std::uint32_t{CAN_STATE_ERROR_PASSIVE})),
                           attribute(IFLA_CAN_RESTART_MS, to_bytes(std::uint32_t{100})),
                           attribute(IFLA_CAN_BERR_COUNTER, to_bytes(can_berr_counter{128, 3}))});
  const Bytes info = join({attribute(IFLA_INFO_KIND, text("can")), attribute(IFLA_INFO_DATA, data),
                           attribute(IFLA_INFO_XSTATS, to_bytes(statistics))});
  return link_message(ARPHRD_CAN, IFF_UP,
                      join({attribute(IFLA_IFNAME, text("can0")), attribute(IFLA_TXQLEN, to_bytes(std::uint32_t{10})),
                            attribute(IFLA_LINKINFO, info), attribute(IFLA_STATS64, to_bytes(traffic))}));
}

}  // namespace

TEST_CASE("CAN interfaces: bit rate, state and counters are read, other interfaces are passed over", "[link]") {
  const Bytes dump =
      join({link_message(ARPHRD_ETHER, IFF_UP, attribute(IFLA_IFNAME, text("eth0"))), make_lonely_adapter(),
            link_message(ARPHRD_CAN, 0,
                         join({attribute(IFLA_IFNAME, text("vcan0")),
                               attribute(IFLA_LINKINFO, attribute(IFLA_INFO_KIND, text("vcan")))}))});
  const std::vector<CanInterface> found = parse_can_interfaces(dump);
  REQUIRE(found.size() == 2);
  const CanInterface& adapter = found[0];
  CHECK(adapter.name == "can0");
  CHECK(adapter.kind == "can");
  CHECK(adapter.is_up);
  CHECK(adapter.queue_length == 10);
  CHECK(adapter.bit_rate_bit_per_s == 500'000U);
  CHECK(adapter.sample_point_permille == 875U);
  CHECK(adapter.state == "error-passive");
  CHECK(adapter.tx_errors == 128);
  CHECK(adapter.rx_errors == 3);
  CHECK(adapter.restart_ms == 100U);
  CHECK(adapter.bus_errors == 17U);
  CHECK(adapter.bus_offs == 2U);
  CHECK(adapter.tx_frames == 5);
  CHECK(found[1].name == "vcan0");
  CHECK(found[1].kind == "vcan");
  CHECK_FALSE(found[1].is_up);
  CHECK_FALSE(found[1].bit_rate_bit_per_s.has_value());
}

TEST_CASE("CAN interfaces: a message that is cut off anywhere is read as far as it goes", "[link]") {
  const Bytes whole = make_lonely_adapter();
  for (std::size_t size = 0; size < whole.size(); ++size) {
    Bytes cut(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(size));
    CHECK(parse_can_interfaces(cut).empty());  // The header says that there is more.
    if (size < sizeof(nlmsghdr)) continue;
    const auto length = static_cast<std::uint32_t>(size);
    std::memcpy(cut.data(), &length, sizeof length);
    CHECK(parse_can_interfaces(cut).size() <= 1);
  }
}
