// Modbus RTU from strangers: no bytes, at whatever pace, may crash a server or a client; what a server answers is a
// frame with a good checksum; however the bytes are cut up, the same frames come out.

#include <algorithm>
#include <vector>

#include "protocols/modbus/rtu_client.hpp"
#include "protocols/modbus/rtu_server.hpp"
#include "tests/fuzz/fuzz.hpp"
#include "tests/protocols/modbus/small_map.hpp"

using namespace meltbench;
using namespace meltbench::modbus;
using fuzz::must;

namespace {

const LineTiming kTiming = make_line_timing(115'200);

void check_frames(std::span<const std::uint8_t> bytes) {
  must(bytes.empty() || bytes.size() >= kMinFrame, "what a server sends is a frame");
  if (bytes.empty()) return;
  must(bytes.size() <= kMaxFrame, "no frame is longer than 256 bytes");
  must(find_length(Direction::kAnswers, bytes) == bytes.size(), "an answer has the length that its head says");
  must(calc_crc(bytes) == 0, "an answer has its checksum");
}

/// Pieces with gaps: low bits of the first byte are the size, its top bit a long silence.
void serve(fuzz::Bytes input) {
  SmallMap map;
  RtuServer server{kTiming};
  server.add(1, map);
  RtuClient client{kTiming, {.answer_timeout = 5ms, .retries = 1}};
  std::vector<std::uint8_t> sent, piece, to_device;
  Instant now{};
  while (!input.empty()) {
    const std::uint8_t how = input.take();
    piece.clear();
    for (int i = 0; i < (how & 0x1F) + 1; ++i) piece.push_back(input.take());
    if ((how & 0x40U) != 0) {  // With a good checksum, so that something gets through.
      const std::uint16_t crc = calc_crc(piece);
      piece.push_back(static_cast<std::uint8_t>(crc & 0xFFU));
      piece.push_back(static_cast<std::uint8_t>(crc >> 8U));
    }
    if ((how & 0x80U) != 0) now += 10ms;
    now += kTiming.on_wire(piece.size());
    if ((how & 0x20U) != 0 && client.is_idle()) {
      Pdu request;
      request.push_bytes(piece);
      client.send(now, piece[0], request, to_device);
    }
    server.on_bytes(now, piece);
    client.on_bytes(now, piece);
    sent.clear();
    server.on_time(now, sent);
    check_frames(sent);
    client.on_time(now, to_device);
    if (const auto result = client.take_result()) {
      std::array<std::uint16_t, 4> words{};
      std::array<bool, 16> bits{};
      (void)read_registers(result->answer, words);
      (void)read_bits(result->answer, bits);
      (void)find_identification(result->answer, 0);
    }
    must(server.next_deadline() > now && client.next_deadline() > now, "what was due has been done");
  }
}

std::vector<std::vector<std::uint8_t>> read_all(Direction direction, std::span<const std::uint8_t> bytes,
                                                std::size_t step) {
  FrameReader reader{direction, kTiming};
  std::vector<std::vector<std::uint8_t>> frames;
  const auto collect = [&] {
    if (const auto frame = reader.take_frame()) frames.emplace_back(frame->pdu.begin(), frame->pdu.end());
  };
  Instant now{};
  for (std::size_t at = 0; at < bytes.size();) {
    const auto piece = bytes.subspan(at, std::min(step, bytes.size() - at));
    now += kTiming.on_wire(piece.size());
    for (auto rest = piece; !rest.empty(); collect()) rest = rest.subspan(reader.take(now, rest));
    at += piece.size();
  }
  reader.on_time(now + 1s);
  collect();
  return frames;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  serve({data, size});
  for (const Direction direction : {Direction::kRequests, Direction::kAnswers}) {
    const auto at_once = read_all(direction, {data, size}, size);
    must(at_once == read_all(direction, {data, size}, 1), "frames do not depend on how their bytes arrive");
    must(at_once == read_all(direction, {data, size}, 7), "frames do not depend on how their bytes arrive");
  }
  return 0;
}
