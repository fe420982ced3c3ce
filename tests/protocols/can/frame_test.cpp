#include "protocols/can/frame.hpp"

#include <catch2/catch.hpp>

using namespace meltbench::can;

TEST_CASE("Frame: an FD length is rounded up to the next one that the DLC can say", "[can]") {
  CHECK(round_up_to_fd_length(0) == 0);
  CHECK(round_up_to_fd_length(8) == 8);
  CHECK(round_up_to_fd_length(9) == 12);
  CHECK(round_up_to_fd_length(33) == 48);
  CHECK(round_up_to_fd_length(64) == 64);
}

TEST_CASE("Frame: what cannot be on a bus is not valid", "[can]") {
  CanFrame frame = make_frame(0x123, {1, 2, 3});
  CHECK(is_valid(frame));
  SECTION("identifier wider than 11 bits") {
    frame.id = 0x800;
  }
  SECTION("nine bytes in a classic frame") {
    frame.length = 9;
  }
  SECTION("bit rate switch without FD") {
    frame.brs = true;
  }
  SECTION("FD with a length that no DLC says") {
    frame.fd = true;
    frame.length = 9;
  }
  SECTION("remote FD frame") {
    frame.fd = true;
    frame.kind = FrameKind::kRemote;
  }
  SECTION("raw DLC without eight bytes") {
    frame.raw_dlc = 9;
  }
  CHECK_FALSE(is_valid(frame));
}

TEST_CASE("Frame: equality looks at the bytes that are sent and at no others", "[can]") {
  CanFrame a = make_frame(0x1, {1, 2});
  CanFrame b = a;
  b.bytes[5] = 9;
  CHECK(a == b);
  b.bytes[1] = 9;
  CHECK_FALSE(a == b);
}
