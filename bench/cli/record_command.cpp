#include "bench/cli/record_command.hpp"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <stdexcept>

#include "bench/cli/version.hpp"
#include "bench/record/bus_recorder.hpp"
#include "protocols/link/can_interface.hpp"
#include "protocols/link/clock.hpp"
#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

std::string bit_rate_text(const link::BusUri& uri) {
  if (uri.kind == link::BusUri::Kind::kSlcan) return fmt::format("{} bit/s", uri.bit_rate_bit_per_s);
  const auto interfaces = link::list_can_interfaces();
  const auto own = std::ranges::find(interfaces, uri.name, &link::CanInterface::name);
  if (own == interfaces.end() || !own->bit_rate_bit_per_s) return "none, the interface is virtual";
  std::string text = fmt::format("{} bit/s", *own->bit_rate_bit_per_s);
  if (own->data_bit_rate_bit_per_s) text += fmt::format(", data {} bit/s", *own->data_bit_rate_bit_per_s);
  return text;
}

std::string write_head(const link::BusUri& uri, Nanos started) {
  return fmt::format(
      "# recording of {} by {}\n"
      "# bit rate: {}\n"
      "# time: seconds since 1970-01-01 UTC; the host's clock at the beginning, and its monotonic clock from then on\n"
      "# host's clock at the beginning: {:%Y-%m-%d %H:%M:%S}.{:06} UTC\n",
      uri.name, kProgramVersion, bit_rate_text(uri), fmt::gmtime(started / 1s), started % 1s / 1us);
}

}  // namespace

ExitStatus record_log(const RecordRequest& request) {
  const link::BusUri uri = link::parse_bus_uri(request.can);
  if (uri.kind != link::BusUri::Kind::kSocketCan && uri.kind != link::BusUri::Kind::kSlcan) {
    throw std::invalid_argument{
        "record needs a kernel interface such as can0, or slcan:PORT; a run on the embedded bus leaves its bus.log"};
  }
  const auto link = link::open_can_link(uri);
  const Nanos started = link::read_clock(CLOCK_REALTIME);
  const std::string device = uri.kind == link::BusUri::Kind::kSlcan ? "slcan0" : uri.name;
  record::LogFilesRequest files{request.out, write_head(uri, started), {}, {}};
  if (files.file.empty()) {
    files.file = fmt::format("{}-{:%Y-%m-%d_%H%M%S}.log", device, fmt::gmtime(started / 1s));
  }
  if (request.rotate_MB) files.max_size = static_cast<std::uint64_t>(*request.rotate_MB * 1e6);
  if (request.rotate_min) files.max_age = nanos_from_s(*request.rotate_min * 60.0);
  record::LogFiles log{std::move(files)};
  runtime::catch_stop_signals();
  fmt::print("recording {} to {}; Ctrl-C ends it\n", device, log.file().string());
  std::fflush(stdout);
  const record::BusRecorderResult result =
      record::record_bus(*link, log, {device, started - link::read_monotonic()}, runtime::stop_requested);
  fmt::print("{} frames in {} file{}, {} dropped by the kernel; the bus was down {} times\n", result.frames,
             log.files(), log.files() == 1 ? "" : "s", result.dropped, result.downs);
  return ExitStatus::kHeld;
}

}  // namespace meltbench::cli
