#include "bench/fault/twin.hpp"

#include <fstream>
#include <iterator>
#include <string>
#include <utility>

#include "protocols/canopen/eds.hpp"
#include "protocols/canopen/manager.hpp"

namespace meltbench::fault {

namespace {

canopen::ObjectDictionary read_dictionary(const Fault& fault) {
  std::ifstream file{fault.eds, std::ios::binary};
  const std::string text{std::istreambuf_iterator<char>{file}, {}};
  try {
    return std::move(canopen::read_eds(text, fault.eds.string(), fault.node_id).dictionary);
  } catch (const canopen::EdsError& error) {
    throw config::ConfigError{fault.table.origin, error.what(), error.hint()};
  }
}

}  // namespace

Twin::Twin(const Fault& fault)
    : runs_{fault.value("running") > 0.0}, heartbeat_{fault.heartbeat}, node_{read_dictionary(fault), fault.node_id} {}

void Twin::plug_in(Instant now, canopen::Frames& out) {
  is_in_ = true;
  const std::size_t before = out.size();
  node_.start(now, out);
  if (!runs_) return;
  constexpr std::uint32_t kSdoRequestBase = 0x600;
  constexpr std::uint8_t kWriteTwoBytes = 0x2B;
  const auto ms = static_cast<unsigned>(heartbeat_ / 1ms);
  const auto low = static_cast<std::uint8_t>(ms & 0xFFU), high = static_cast<std::uint8_t>(ms >> 8U);
  const std::uint8_t node_id = node_.node_id();
  node_.on_frame(now, can::make_frame(kSdoRequestBase + node_id, {kWriteTwoBytes, 0x17, 0x10, 0, low, high, 0, 0}),
                 out);
  node_.on_frame(now, canopen::make_nmt_command(canopen::NmtCommand::kStart, node_id), out);
  out.resize(before);  // All that was long ago.
}

}  // namespace meltbench::fault
