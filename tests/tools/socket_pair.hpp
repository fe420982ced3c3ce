#pragma once

#include <sys/socket.h>

#include <array>
#include <catch2/catch.hpp>

#include "protocols/link/unique_fd.hpp"

namespace meltbench::test {

/// Two connected ends. Datagrams stay whole, as on a CAN socket or the bench's: SOCK_DGRAM, SOCK_SEQPACKET.
inline std::array<link::UniqueFd, 2> make_socket_pair(int type) {
  std::array<int, 2> ends{};
  REQUIRE(::socketpair(AF_UNIX, type, 0, ends.data()) == 0);
  return {link::UniqueFd{ends[0]}, link::UniqueFd{ends[1]}};
}

}  // namespace meltbench::test
