#pragma once

#include <optional>

#include "bench/cli/run_request.hpp"

namespace meltbench::cli {

/// The tap of one run, if the user wants one: says where it is, waits for those who are to look on, and at the end
/// tells what clients have lost.
class RunTap {
 public:
  /// @throws link::LinkError if it cannot be opened.
  explicit RunTap(const RunRequest& request);
  /// Lets the clients read what waits for them: the run is over.
  ~RunTap();
  RunTap(const RunTap&) = delete;
  RunTap& operator=(const RunTap&) = delete;

  /// Null if there is no tap.
  [[nodiscard]] bus::Outside* outside() { return tap_ ? &*tap_ : nullptr; }

 private:
  std::optional<tap::Tap> tap_;
};

}  // namespace meltbench::cli
