// What a log of strangers says on the bus of a known machine: no order of frames and no content may crash who decodes
// it, every frame can be told in words, what happened is told in the order of time, and what is made of it are faults
// and checks that a scenario may have. Input: records of a pause, an identifier in two bytes, a length with flags, and
// the data.

#include <algorithm>
#include <string>

#include "bench/decode/extraction.hpp"
#include "bench/decode/story.hpp"
#include "protocols/config/toml.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using fuzz::must;

namespace {

const config::Rig& rig() {
  static const config::Rig rig = [] {
    config::Rig all =
        config::read_rig(config::Section{config::read_toml_file(MELTBENCH_SOURCE_DIR "/fixtures/rigs/coupled.toml")});
    // Every run reads the boards' EDS files: three of them are three times as many runs.
    std::erase_if(all.boards, [](const config::RigBoard& board) {
      return board.kind == config::BoardKind::kHeater || board.kind == config::BoardKind::kMeltCamera ||
             board.kind == config::BoardKind::kScrewDrive;
    });
    return all;
  }();
  return rig;
}

Nanos take_pause(fuzz::Bytes& bytes) {
  const std::uint8_t pause = bytes.take();
  return pause < 0xF0 ? Nanos{pause * 100'000} : Nanos{(pause - 0xEF) * 1'000'000'000LL};
}

can::CanFrame take_frame(fuzz::Bytes& bytes) {
  can::CanFrame frame;
  frame.id = bytes.take();
  frame.id |= static_cast<std::uint32_t>(bytes.take() & 0x07U) << 8U;
  const std::uint8_t shape = bytes.take();
  frame.length = std::min<std::uint8_t>(shape & 0x0FU, can::kMaxClassicLength);
  if ((shape & 0xF0U) == 0xF0U) {
    frame.kind = can::FrameKind::kError;
    frame.length = can::kMaxClassicLength;
  } else if ((shape & 0xF0U) == 0xE0U) {
    frame.kind = can::FrameKind::kRemote;
    return frame;
  }
  std::generate_n(frame.bytes.begin(), frame.length, [&bytes] { return bytes.take(); });
  return frame;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Bytes bytes{data, size};
  decode::Story story{rig()};
  Instant now{};
  while (!bytes.empty()) {
    now = now + take_pause(bytes);
    const can::CanFrame frame = take_frame(bytes);
    must(can::is_valid(frame), "the test makes frames that can exist");
    story.take(now, frame);
    must(!story.view().describe(frame).empty(), "a frame can be told in words");
  }
  story.finish();
  must(std::ranges::is_sorted(story.findings(), {}, &decode::Finding::at), "findings are in the order of time");
  for (const decode::Finding& finding : story.findings()) {
    must(!finding.text.empty(), "a finding has words");
    must(finding.at <= now && (!finding.until || *finding.until <= now), "it happened before the end");
  }
  const decode::Extraction found = decode::extract(story.findings(), story.end(), rig());
  must(found.faults.size() <= 500 && found.checks.size() <= 501, "nobody reads more");
  for (const config::Table& fault : found.faults) {
    const double at_s = std::get<double>(fault.find("at_s")->value.data);
    must(at_s >= 0.0 && at_s <= to_s(now) + 1.0, "a fault begins within the log");
    const config::Entry* lasts = fault.find("for_s");
    must(lasts == nullptr || std::get<double>(lasts->value.data) > 0.0, "a fault lasts");
  }
  must(decode::describe_difference(found.reactions, found.reactions, rig()).empty(), "a log repeats itself");
  return 0;
}
