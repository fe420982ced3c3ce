#pragma once

namespace meltbench::runtime {

/// From now on SIGINT and SIGTERM ask the loops to end instead of killing the process; a second one kills.
void catch_stop_signals();

/// True once such a signal has come.
[[nodiscard]] bool stop_requested() noexcept;

}  // namespace meltbench::runtime
