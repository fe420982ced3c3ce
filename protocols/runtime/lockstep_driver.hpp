#pragma once

#include "protocols/link/bench_socket.hpp"
#include "protocols/participant/participant.hpp"

namespace meltbench::runtime {

/// How a driver's loop ended. kStopped: the bench said so, or a signal. kBenchLost: the broker has gone.
enum class DriverEnd : std::uint8_t { kStopped, kBenchLost };

/// Lockstep driver: blocks in one call until the broker wakes this program, answers, blocks again. Reads no clock.
/// @param socket  connected and welcomed.
[[nodiscard]] DriverEnd run_lockstep(Participant& participant, link::BenchSocket& socket);

}  // namespace meltbench::runtime
