#include "bench/cli/run_tap.hpp"

#include <fmt/format.h>

#include <cstdio>

#include "protocols/runtime/stop_signal.hpp"

namespace meltbench::cli {
namespace {

/// A client that has read nothing for so long after the run does not read any more.
constexpr Nanos kPatience = 500ms;

}  // namespace

RunTap::RunTap(const RunRequest& request) {
  if (!request.tap.is_wanted()) return;
  tap_.emplace(request.tap);
  for (const std::string& place : tap_->places()) fmt::print("tap: {}\n", place);
  std::fflush(stdout);  // Whoever reads a pipe wants to connect now.
  tap_->wait_for(request.tap_wait, runtime::stop_requested);
}

RunTap::~RunTap() {
  if (!tap_) return;
  tap_->drain(kPatience);
  for (const std::string& complaint : tap_->complaints()) fmt::print("tap: {}\n", complaint);
}

}  // namespace meltbench::cli
