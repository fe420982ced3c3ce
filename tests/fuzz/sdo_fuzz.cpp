// SDO from both sides. The first byte says which: a node that gets any frames, a client that gets any answers, or
// client and server with frames lost in between; what the client then calls done must be what the server holds.

#include <algorithm>
#include <array>
#include <optional>
#include <utility>
#include <vector>

#include "protocols/canopen/eds.hpp"
#include "protocols/canopen/node.hpp"
#include "protocols/canopen/sdo_client.hpp"
#include "protocols/canopen/sdo_server.hpp"
#include "tests/fuzz/fuzz.hpp"

using namespace meltbench;
using canopen::AbortCode;
using canopen::Frames;
using canopen::ObjectAddress;
using fuzz::Bytes;
using fuzz::must;

namespace {

constexpr std::uint8_t kNodeId = 5;
constexpr std::uint32_t kRequestId = 0x600 + kNodeId;
constexpr std::uint32_t kAnswerId = 0x580 + kNodeId;

// A node with what a board has: identity, heartbeats, EMCY, one RPDO and one TPDO, values of several lengths.
constexpr std::string_view kEds = R"([FileInfo]
EDSVersion=4.0
[DeviceInfo]
NrOfRXPDO=1
NrOfTXPDO=1
Granularity=8
[MandatoryObjects]
SupportedObjects=3
1=0x1000
2=0x1001
3=0x1018
[1000]
ParameterName=Device type
ObjectType=0x7
DataType=0x0007
AccessType=ro
DefaultValue=0x191
[1001]
ParameterName=Error register
ObjectType=0x7
DataType=0x0005
AccessType=ro
PDOMapping=1
[1018]
ParameterName=Identity
ObjectType=0x9
SubNumber=2
[1018sub0]
ParameterName=Highest sub-index
DataType=0x0005
AccessType=ro
DefaultValue=1
[1018sub1]
ParameterName=Vendor
DataType=0x0007
AccessType=ro
[OptionalObjects]
SupportedObjects=9
1=0x1003
2=0x1005
3=0x1014
4=0x1016
5=0x1017
6=0x1400
7=0x1600
8=0x1800
9=0x1A00
[1003]
ParameterName=Error history
ObjectType=0x8
DataType=0x0007
AccessType=ro
CompactSubObj=4
[1005]
ParameterName=COB-ID SYNC
DataType=0x0007
AccessType=rw
DefaultValue=0x80
[1014]
ParameterName=COB-ID EMCY
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x80
[1016]
ParameterName=Consumer heartbeat
ObjectType=0x8
DataType=0x0007
AccessType=rw
CompactSubObj=2
[1017]
ParameterName=Producer heartbeat
DataType=0x0006
AccessType=rw
[1400]
ParameterName=RPDO 1
ObjectType=0x9
SubNumber=3
[1400sub0]
ParameterName=Highest sub-index
DataType=0x0005
AccessType=ro
DefaultValue=2
[1400sub1]
ParameterName=COB-ID
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x200
[1400sub2]
ParameterName=Type
DataType=0x0005
AccessType=rw
DefaultValue=255
[1600]
ParameterName=RPDO 1 map
ObjectType=0x8
SubNumber=3
[1600sub0]
ParameterName=Count
DataType=0x0005
AccessType=rw
DefaultValue=1
[1600sub1]
ParameterName=First
DataType=0x0007
AccessType=rw
DefaultValue=0x20000020
[1600sub2]
ParameterName=Second
DataType=0x0007
AccessType=rw
DefaultValue=0
[1800]
ParameterName=TPDO 1
ObjectType=0x9
SubNumber=5
[1800sub0]
ParameterName=Highest sub-index
DataType=0x0005
AccessType=ro
DefaultValue=5
[1800sub1]
ParameterName=COB-ID
DataType=0x0007
AccessType=rw
DefaultValue=$NODEID+0x180
[1800sub2]
ParameterName=Type
DataType=0x0005
AccessType=rw
DefaultValue=1
[1800sub3]
ParameterName=Inhibit time
DataType=0x0006
AccessType=rw
[1800sub5]
ParameterName=Event timer
DataType=0x0006
AccessType=rw
[1A00]
ParameterName=TPDO 1 map
ObjectType=0x8
SubNumber=3
[1A00sub0]
ParameterName=Count
DataType=0x0005
AccessType=rw
DefaultValue=1
[1A00sub1]
ParameterName=First
DataType=0x0007
AccessType=rw
DefaultValue=0x20000020
[1A00sub2]
ParameterName=Second
DataType=0x0007
AccessType=rw
DefaultValue=0
[ManufacturerObjects]
SupportedObjects=3
1=0x2000
2=0x2001
3=0x2002
[2000]
ParameterName=Value
DataType=0x0007
AccessType=rw
PDOMapping=1
[2001]
ParameterName=Text
DataType=0x0009
AccessType=rw
DefaultValue=a text longer than one segment
[2002]
ParameterName=File
DataType=0x000F
AccessType=rw
)";

can::CanFrame take_frame(Bytes& input, std::uint32_t id) {
  std::array<std::uint8_t, 8> data{};
  for (std::uint8_t& byte : data) byte = input.take();
  return can::make_frame(id, data);
}

void feed_node(Bytes& input) {
  constexpr std::array<std::uint32_t, 8> kIds{kRequestId, kRequestId, kRequestId, 0x000, 0x080, 0x205, 0x701, 0x705};
  canopen::Node node{canopen::read_eds(kEds, "built-in.eds", kNodeId).dictionary, kNodeId};
  Frames out;
  Instant now{};
  node.start(now, out);
  while (!input.empty()) {
    const std::uint8_t control = input.take();
    can::CanFrame frame = take_frame(input, kIds[control % kIds.size()]);
    if ((control & 0x08U) != 0) frame.length = frame.bytes[7] % 9;
    if ((control & 0x10U) != 0) frame.kind = can::FrameKind::kRemote;
    now += (control >> 5U) * 10ms;
    out.clear();
    node.on_time(now, out);
    node.on_frame(now, frame, out);
    must(out.size() < 1000, "one frame does not start a flood");
    for (const can::CanFrame& sent : out) must(can::is_valid(sent), "a node sends frames that can exist on a bus");
  }
}

void feed_client(Bytes& input) {
  canopen::SdoClient client{kNodeId};
  Frames out;
  Instant now{};
  const std::uint8_t control = input.take();
  const auto mode = (control & 1U) != 0 ? canopen::SdoMode::kBlock : canopen::SdoMode::kPlain;
  const ObjectAddress address{0x2000, 0};
  if ((control & 2U) != 0) {
    client.start_download(now, address, std::vector<std::uint8_t>(control, 0x55), out, mode);
  } else {
    client.start_upload(now, address, out, mode);
  }
  while (!input.empty() && client.status() == canopen::SdoStatus::kBusy) {
    now += (input.take() % 4) * 1ms;
    out.clear();
    client.on_time(now, out);
    client.on_frame(now, take_frame(input, kAnswerId), out);
    for (const can::CanFrame& sent : out) must(sent.id == kRequestId && sent.length == 8, "requests have SDO's shape");
  }
  if (client.status() == canopen::SdoStatus::kBusy) {
    must(client.next_deadline() < Instant::never(), "a busy client has a deadline");
    client.on_time(now + 3600s, out);
    must(client.status() != canopen::SdoStatus::kBusy, "a silent server ends a transfer");
  }
}

/// One object of any length.
class OneValue final : public canopen::SdoObjects {
 public:
  std::vector<std::uint8_t> value;
  AbortCode read(Instant, ObjectAddress, std::vector<std::uint8_t>& out) override {
    out = value;
    return AbortCode::kNone;
  }
  AbortCode begin_write(ObjectAddress, std::optional<std::size_t>) override { return AbortCode::kNone; }
  std::size_t capacity(ObjectAddress) override { return 100'000; }
  AbortCode write(Instant, ObjectAddress, std::span<const std::uint8_t> written) override {
    value.assign(written.begin(), written.end());
    return AbortCode::kNone;
  }
};

void lose_frames(Bytes& input) {
  const std::uint8_t control = input.take();
  const std::size_t size = input.take() + 256U * (input.take() % 4U);
  const bool upload = (control & 1U) != 0;
  const auto mode = (control & 2U) != 0 ? canopen::SdoMode::kBlock : canopen::SdoMode::kPlain;
  std::vector<std::uint8_t> content(size);
  for (std::size_t i = 0; i < size; ++i) content[i] = static_cast<std::uint8_t>(i * 7 + control);

  OneValue object;
  if (upload) object.value = content;
  canopen::SdoServer server{kRequestId, kAnswerId, object};
  canopen::SdoClient client{kNodeId};
  Frames to_server, to_client;
  Instant now{};
  if (upload) {
    client.start_upload(now, {0x2002, 0}, to_server, mode);
  } else {
    client.start_download(now, {0x2002, 0}, content, to_server, mode);
  }
  int rounds = 0;
  while (client.status() == canopen::SdoStatus::kBusy) {
    must(++rounds < 10'000, "a transfer comes to an end");
    const auto lost = [&] { return !input.empty() && (input.take() & 0x0FU) == 0x0FU; };
    const Frames requests = std::exchange(to_server, {});
    for (const can::CanFrame& frame : requests) {
      if (!lost()) server.on_frame(now, frame, to_client);
    }
    const Frames answers = std::exchange(to_client, {});
    for (const can::CanFrame& frame : answers) {
      if (!lost()) client.on_frame(now, frame, to_server);
    }
    if (!to_server.empty() || client.status() != canopen::SdoStatus::kBusy) continue;
    now = std::max(now, std::min(client.next_deadline(), server.next_deadline()));
    server.on_time(now, to_client);
    client.on_time(now, to_server);
  }
  if (client.status() != canopen::SdoStatus::kDone) return;
  must(client.result().value == content, "the client holds what it asked for");
  must(object.value == content, "the server holds what it was given");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes input{data, size};
  switch (input.take() % 3) {
    case 0:
      feed_node(input);
      break;
    case 1:
      feed_client(input);
      break;
    default:
      lose_frames(input);
      break;
  }
  return 0;
}
