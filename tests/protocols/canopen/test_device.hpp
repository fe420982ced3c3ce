#pragma once
/// A small made-up device for the tests: dictionary, node, and a wire on which time passes.

#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "protocols/can/frame.hpp"
#include "protocols/canopen/manager.hpp"
#include "protocols/canopen/node.hpp"
#include "protocols/time/instant.hpp"

namespace meltbench::canopen::testing {

inline constexpr std::uint8_t kNode = 5;

/// Communication objects, two RPDOs, three TPDOs, and application objects at 0x2000 and 0x6000.
inline ObjectDictionary make_dictionary() {
  using enum DataType;
  using enum AccessType;
  ObjectDictionary od;
  const auto number = [&od](std::uint16_t index, std::uint8_t sub, DataType type, AccessType access, auto value,
                            bool mappable = false) { od.add_number(index, sub, type, access, value, mappable); };
  const auto u8 = [](int value) { return static_cast<std::uint8_t>(value); };
  const auto u16 = [](int value) { return static_cast<std::uint16_t>(value); };
  const auto u32 = [](std::uint32_t value) { return value; };

  number(0x1000, 0, kUnsigned32, kReadOnly, u32(0x00020194));
  number(0x1001, 0, kUnsigned8, kReadOnly, u8(0), true);
  number(0x1003, 0, kUnsigned8, kReadWrite, u8(0));
  for (std::uint8_t sub = 1; sub <= 4; ++sub) number(0x1003, sub, kUnsigned32, kReadOnly, u32(0));
  number(0x1005, 0, kUnsigned32, kReadWrite, u32(0x80));
  number(0x1006, 0, kUnsigned32, kReadWrite, u32(0));
  number(0x1007, 0, kUnsigned32, kReadWrite, u32(0));
  od.add({.address = {0x1008, 0},
          .name = "name",
          .type = kVisibleString,
          .access = kConst,
          .default_value = {'T', 'e', 's', 't', ' ', 'd', 'e', 'v', 'i', 'c', 'e'},
          .low_limit = {},
          .high_limit = {}});
  number(0x100C, 0, kUnsigned16, kReadWrite, u16(0));
  number(0x100D, 0, kUnsigned8, kReadWrite, u8(0));
  number(0x1010, 0, kUnsigned8, kReadOnly, u8(4));
  number(0x1011, 0, kUnsigned8, kReadOnly, u8(4));
  for (std::uint8_t sub = 1; sub <= 4; ++sub) {
    number(0x1010, sub, kUnsigned32, kReadWrite, u32(1));
    number(0x1011, sub, kUnsigned32, kReadWrite, u32(1));
  }
  number(0x1014, 0, kUnsigned32, kReadWrite, u32(0x80 + kNode));
  number(0x1015, 0, kUnsigned16, kReadWrite, u16(0));
  number(0x1016, 0, kUnsigned8, kReadOnly, u8(2));
  number(0x1016, 1, kUnsigned32, kReadWrite, u32(0));
  number(0x1016, 2, kUnsigned32, kReadWrite, u32(0));
  number(0x1017, 0, kUnsigned16, kReadWrite, u16(0));
  number(0x1018, 0, kUnsigned8, kReadOnly, u8(4));
  for (std::uint8_t sub = 1; sub <= 4; ++sub) number(0x1018, sub, kUnsigned32, kReadOnly, u32(sub));
  number(0x1019, 0, kUnsigned8, kReadWrite, u8(0));
  number(0x1029, 0, kUnsigned8, kReadOnly, u8(1));
  number(0x1029, 1, kUnsigned8, kReadWrite, u8(0));

  const auto pdo = [&](std::uint16_t base, unsigned n, std::uint32_t cob_id, int type, std::vector<std::uint32_t> map) {
    const auto parameters = static_cast<std::uint16_t>(base + n - 1);
    const auto mapping = static_cast<std::uint16_t>(parameters + 0x200);
    const bool transmits = base == 0x1800;
    number(parameters, 0, kUnsigned8, kReadOnly, u8(transmits ? 6 : 5));
    number(parameters, 1, kUnsigned32, kReadWrite, cob_id);
    number(parameters, 2, kUnsigned8, kReadWrite, u8(type));
    if (transmits) number(parameters, 3, kUnsigned16, kReadWrite, u16(0));
    number(parameters, 5, kUnsigned16, kReadWrite, u16(0));
    if (transmits) number(parameters, 6, kUnsigned8, kReadWrite, u8(0));
    number(mapping, 0, kUnsigned8, kReadWrite, u8(static_cast<int>(map.size())));
    for (std::uint8_t sub = 1; sub <= 8; ++sub) {
      number(mapping, sub, kUnsigned32, kReadWrite, sub <= map.size() ? map[sub - 1] : 0U);
    }
  };
  pdo(0x1400, 1, 0x200 + kNode, 255, {0x6040'0010, 0x6042'0010});
  pdo(0x1400, 2, 0x300 + kNode, 1, {0x2001'0020});
  pdo(0x1800, 1, 0x180 + kNode, 255, {0x6041'0010});
  pdo(0x1800, 2, 0x280 + kNode, 1, {0x2002'0020, 0x2003'0008});
  pdo(0x1800, 3, 0x8000'0380 + kNode, 255, {});

  number(0x2000, 0, kUnsigned32, kReadWrite, u32(7));
  number(0x2001, 0, kReal32, kReadWriteWrite, 1.5F, true);
  number(0x2002, 0, kReal32, kReadOnly, 0.25F, true);
  number(0x2003, 0, kUnsigned8, kReadOnly, u8(0x42), true);
  number(0x2004, 0, kUnsigned32, kWriteOnly, u32(0));
  od.add({.address = {0x2005, 0},
          .name = "limited",
          .type = kInteger16,
          .access = kReadWrite,
          .default_value = to_bytes(std::int16_t{0}),
          .low_limit = to_bytes(std::int16_t{-10}),
          .high_limit = to_bytes(std::int16_t{100})});
  od.add({.address = {0x2006, 0},
          .name = "blob",
          .object_code = ObjectCode::kDomain,
          .type = kDomain,
          .access = kReadWrite,
          .default_value = {},
          .low_limit = {},
          .high_limit = {}});
  number(0x6040, 0, kUnsigned16, kReadWriteWrite, u16(0), true);
  number(0x6041, 0, kUnsigned16, kReadOnly, u16(0x1234), true);
  number(0x6042, 0, kInteger16, kReadWriteWrite, std::int16_t{0}, true);
  number(0x6064, 0, kInteger32, kReadOnly, std::int32_t{-2}, true);
  number(0x6065, 0, kUnsigned32, kReadWrite, u32(100));
  for (std::uint16_t index = 1; index <= 7; ++index) od.allow_dummy(index, true);
  return od;
}

/// Hex bytes of a frame as candump shows them: "585#60002001".
inline std::string show(const can::CanFrame& frame) {
  constexpr const char* kDigits = "0123456789ABCDEF";
  std::string text;
  for (int shift = 8; shift >= 0; shift -= 4) text += kDigits[frame.id >> shift & 0xFU];
  text += '#';
  for (const std::uint8_t byte : frame.data()) {
    text += kDigits[byte >> 4];
    text += kDigits[byte & 0xFU];
  }
  return text;
}

inline std::vector<std::string> show(const Frames& frames) {
  std::vector<std::string> text;
  for (const can::CanFrame& frame : frames) text.push_back(show(frame));
  return text;
}

using Lines = std::vector<std::string>;

/// Writes down what its node tells it.
class NoteTaker : public NodeListener {
 public:
  AbortCode on_write(Instant, const OdEntry& entry, std::span<const std::uint8_t> value) override {
    return refuse ? refuse(entry, value) : AbortCode::kNone;
  }
  void on_written(Instant, const OdEntry& entry) override { note("written " + text(entry.address())); }
  AbortCode on_read(Instant, OdEntry& entry) override {
    if (refresh) refresh(entry);
    return AbortCode::kNone;
  }
  void on_sync(Instant, std::uint8_t counter) override {
    note("sync " + std::to_string(counter));
    if (at_sync) at_sync();
  }
  void on_rpdo(Instant, unsigned number) override { note("rpdo " + std::to_string(number)); }
  void on_rpdo_timeout(Instant, unsigned number) override { note("rpdo timeout " + std::to_string(number)); }
  void before_tpdo(Instant, unsigned number) override { note("tpdo " + std::to_string(number)); }
  void on_state(Instant, NmtState, NmtState to) override { note("state " + std::string{text(to)}); }
  void on_reset(Instant, ResetKind) override { note("reset"); }
  void on_heartbeat(Instant, const HeartbeatEvent& event) override {
    constexpr std::array kNames{"first", "boot-up", "state", "lost", "back"};
    note(std::string{"node "} + std::to_string(event.node) + " " + kNames[static_cast<std::size_t>(event.change)]);
  }
  void on_stored(Instant) override { note("stored"); }

  Lines take() { return std::exchange(notes_, {}); }

  std::function<AbortCode(const OdEntry&, std::span<const std::uint8_t>)> refuse;
  std::function<void(OdEntry&)> refresh;
  std::function<void()> at_sync;

 private:
  using Text = std::string;
  static std::string text(ObjectAddress address) { return canopen::text(address); }
  static std::string_view text(NmtState state) { return canopen::text(state); }
  void note(Text what) { notes_.push_back(std::move(what)); }
  Lines notes_;
};

/// The test device on a wire: frames go in, what it sends is collected, time passes from deadline to deadline.
class Device {
 public:
  Device() : node{make_dictionary(), kNode, &notes} {}
  explicit Device(ObjectDictionary od) : node{std::move(od), kNode, &notes} {}

  Lines start() {
    return collect([this](Frames& out) { node.start(now, out); });
  }
  Lines send(const can::CanFrame& frame) {
    return collect([&](Frames& out) { node.on_frame(now, frame, out); });
  }
  Lines send(std::uint32_t id, std::initializer_list<std::uint8_t> bytes) { return send(can::make_frame(id, bytes)); }
  Lines send_remote(std::uint32_t id) {
    can::CanFrame frame = can::make_frame(id, {});
    frame.kind = can::FrameKind::kRemote;
    return send(frame);
  }
  Lines sync() { return send(0x080, {}); }
  Lines nmt(NmtCommand command, std::uint8_t to = kNode) { return send(make_nmt_command(command, to)); }
  Lines go_operational() {
    Lines lines = start();
    const Lines more = nmt(NmtCommand::kStart);
    lines.insert(lines.end(), more.begin(), more.end());
    return lines;
  }

  /// Lets time pass; what is sent meanwhile, each line with its time in ms: "10 705#05".
  Lines pass(Nanos span) {
    const Instant end = now + span;
    Lines lines;
    while (node.next_deadline() <= end) {
      now = std::max(now, node.next_deadline());
      Frames out;
      node.on_time(now, out);
      for (const std::string& line : show(out)) {
        lines.push_back(std::to_string(now.since_start / 1ms) + " " + line);
      }
    }
    now = end;
    return lines;
  }

  /// SDO write as a master does it. @returns the abort code.
  template <class T>
  AbortCode write(std::uint16_t index, std::uint8_t sub, T value) {
    SdoClient client{kNode};
    Frames requests;
    client.start_download(now, {index, sub}, to_bytes(value), requests);
    return run(client, requests);
  }
  template <class T>
  T read(std::uint16_t index, std::uint8_t sub) {
    SdoClient client{kNode};
    Frames requests;
    client.start_upload(now, {index, sub}, requests);
    last_code = run(client, requests);
    return client.result().value.size() == sizeof(T) ? load<T>(client.result().value) : T{};
  }
  AbortCode run(SdoClient& client, Frames requests) {
    while (client.status() == SdoStatus::kBusy && !requests.empty()) {
      Frames answers;
      for (const auto& request : requests) node.on_frame(now, request, answers);
      requests.clear();
      for (const auto& answer : answers) {
        if (answer.id == cob_id::sdo_response(kNode)) {
          client.on_frame(now, answer, requests);
        } else {
          others.push_back(show(answer));
        }
      }
    }
    return client.status() == SdoStatus::kDone ? AbortCode::kNone : client.result().abort_code;
  }

  Instant now{};
  NoteTaker notes;
  Node node;
  AbortCode last_code{};
  Lines others;  ///< Frames that came while an SDO transfer ran.

 private:
  template <class Action>
  Lines collect(Action action) {
    Frames out;
    action(out);
    if (node.next_deadline() <= now) node.on_time(now, out);
    return show(out);
  }
};

}  // namespace meltbench::canopen::testing
