#include "bench/tap/socketcand.hpp"

#include <catch2/catch.hpp>

using namespace meltbench;
using tap::Socketcand;

namespace {

/// A server, what it has answered, and what it would put on the bus.
struct Talk {
  Socketcand server{false};
  std::string answers;
  std::vector<can::CanFrame> sent;

  std::size_t hear(std::string_view said, std::size_t room = 100) {
    answers.clear();
    return server.hear(said, room, answers, sent);
  }
  void enter_raw_mode() {
    hear("< open can0 >< rawmode >");
    REQUIRE(server.wants_frames());
  }
};

can::CanFrame make_extended(std::uint32_t id, std::span<const std::uint8_t> data) {
  can::CanFrame frame = can::make_frame(0, data);
  frame.id = id;
  frame.extended = true;
  return frame;
}

}  // namespace

TEST_CASE("socketcand: greeting, bus and raw mode are answered bare, as clients compare them", "[tap]") {
  Talk talk;
  talk.server.greet(talk.answers);
  CHECK(talk.answers == "< hi >");
  talk.hear("< open can0 >");
  CHECK(talk.answers == "< ok >");
  CHECK_FALSE(talk.server.wants_frames());
  talk.hear("< rawmode >");
  CHECK(talk.answers == "< ok >");
  CHECK(talk.server.wants_frames());
}

TEST_CASE("socketcand: nothing works before a bus is open", "[tap]") {
  Talk talk;
  for (const char* const said : {"< rawmode >", "< send 123 0 >", "< open >", "< sing >"}) {
    talk.hear(said);
    CHECK(talk.answers == "< error no open bus >");
  }
  CHECK(talk.sent.empty());
  CHECK_FALSE(talk.server.wants_frames());
  talk.hear("< echo >");
  CHECK(talk.answers == "< echo >");
}

TEST_CASE("socketcand: modes that it has not are refused, and the client stays where it was", "[tap]") {
  Talk talk;
  talk.enter_raw_mode();
  for (const char* const said : {"< bcmmode >", "< controlmode >", "< isotpmode >", "< subscribe 0 0 123 >"}) {
    talk.hear(said);
    CHECK(talk.answers == "< error unknown command >\n");
  }
  CHECK(talk.server.wants_frames());
}

TEST_CASE("socketcand: what python-can and SavvyCAN send arrives as they mean it", "[tap]") {
  Talk talk;
  talk.enter_raw_mode();
  const std::uint8_t read_device_type[] = {0x40, 0, 0x10, 0, 0, 0, 0, 0};
  talk.hear("< send 605 8 40 0 10 0 0 0 0 0 >");  // python-can: no leading zeros, neither id nor data.
  talk.hear("< send 80 0  >");                    // python-can: an empty frame.
  talk.hear("< send 92345678 1 ff >");            // SavvyCAN: bit 31 marks an extended id.
  talk.hear("< send ffffffff92345678 2 ffffffffffffff80 ffffffff >");  // SavvyCAN: negative, 64 or 32 bits wide.
  talk.hear("< send 00000123 1 FF >\r\n< send 12345 0 >");  // Eight digits, and one too large for eleven bits.
  CHECK(talk.answers.empty());
  REQUIRE(talk.sent.size() == 6);
  CHECK(talk.sent[0] == can::make_frame(0x605, read_device_type));
  CHECK(talk.sent[1] == can::make_frame(0x080, {}));
  const std::uint8_t ff[] = {0xFF};
  CHECK(talk.sent[2] == make_extended(0x12345678, ff));
  const std::uint8_t negative[] = {0x80, 0xFF};
  CHECK(talk.sent[3] == make_extended(0x12345678, negative));
  CHECK(talk.sent[4] == make_extended(0x123, ff));
  CHECK(talk.sent[5] == make_extended(0x12345, {}));
}

TEST_CASE("socketcand: what is no frame is refused, and the next one is understood", "[tap]") {
  for (const char* const words :
       {"", "605", "605 9 1 2 3 4 5 6 7 8 9", "605 2 1", "605 1 100", "605 1 1 2", "123456789 0", "ffffffff12345678 0",
        "60G 0", "605 -1", "605 1 -1", "605 1 ffffffffffffff7f", "605 1 fffffff80", "605 ff80 0", "605 1 ffffffff0",
        "100000605 0"}) {
    INFO(words);
    CHECK_FALSE(tap::parse_send(words).has_value());
    Talk talk;
    talk.enter_raw_mode();
    talk.hear(std::string{"< send "} + words + " >< send 1 0 >");
    CHECK(talk.answers == "< error could not parse send command >\n");
    CHECK(talk.sent.size() == 1);
  }
}

TEST_CASE("socketcand: a message that comes in pieces is understood when it is whole", "[tap]") {
  Talk talk;
  talk.enter_raw_mode();
  const std::string whole = " \n< send 605 1 AB >";
  for (std::size_t size = 0; size < whole.size(); ++size) {
    // Blanks before a message may be used up; nothing of the message is.
    CHECK(talk.hear(std::string_view{whole}.substr(0, size)) <= whole.find('<'));
    CHECK(talk.sent.empty());
  }
  CHECK(talk.hear(whole) == whole.size());
  CHECK(talk.sent.size() == 1);
}

TEST_CASE("socketcand: it stops before the frame that it has no room for", "[tap]") {
  Talk talk;
  talk.enter_raw_mode();
  const std::string first = "< send 1 0 >";
  const std::string said = first + "< send 2 0 >< echo >";
  CHECK(talk.hear(said, 1) == first.size());
  CHECK(talk.sent.size() == 1);
  CHECK(talk.hear(said.substr(first.size()), 0) == 0);
  CHECK(talk.hear(said.substr(first.size()), 5) == said.size() - first.size());
  CHECK(talk.sent.back().id == 2);
  CHECK(talk.answers == "< echo >\n");
}

TEST_CASE("socketcand: a message without end does not fill the memory", "[tap]") {
  Talk talk;
  const std::string endless = "<" + std::string(1000, 'x');
  CHECK(talk.hear(endless) == endless.size());
  CHECK(talk.answers == "< error message too long >");
}

TEST_CASE("socketcand: a tap to look at refuses what is sent", "[tap]") {
  Socketcand server{true};
  std::string answers;
  std::vector<can::CanFrame> sent;
  static_cast<void>(server.hear("< open can0 >< rawmode >< send 605 0 >", 1, answers, sent));
  CHECK(answers == "< ok >< ok >< error this tap is read only >\n");
  CHECK(sent.empty());
}

TEST_CASE("socketcand: frames are told with id, time of the run and data, each with a line end", "[tap]") {
  Socketcand server{false};
  const auto told = [&server](const can::CanFrame& frame) {
    std::string out;
    server.tell({Instant{12'340'001'999ns}, frame}, out);
    return out;
  };
  const std::uint8_t data[] = {0x11, 0x0A, 0xFF};
  CHECK(told(can::make_frame(0x85, data)) == "< frame 085 12.340001 110AFF >\n");
  CHECK(told(can::make_frame(0x80, {})) == "< frame 080 12.340001  >\n");
  CHECK(told(make_extended(0x123, data)) == "< frame 00000123 12.340001 110AFF >\n");
  can::CanFrame error;
  error.kind = can::FrameKind::kError;
  error.id = 0x4;
  error.length = 8;
  CHECK(told(error) == "< error 004 12.340001 >\n");
}

TEST_CASE("socketcand: what raw mode cannot say is left out", "[tap]") {
  Socketcand server{false};
  std::string out;
  can::CanFrame remote = can::make_frame(0x705, {});
  remote.kind = can::FrameKind::kRemote;
  server.tell({Instant{}, remote}, out);
  can::CanFrame fd = can::make_frame(0x123, {1});
  fd.fd = true;
  server.tell({Instant{}, fd}, out);
  CHECK(out.empty());
}
