#pragma once

namespace meltbench::runtime {

/// Gives the calling thread a SCHED_FIFO priority, 1..99: it then runs before everything of a lower one.
/// @throws link::LinkError with what to do, if this user may not have it.
void take_priority(int priority);

/// Makes a process fit for a real-time loop: takes the priority, keeps all memory that it has and will have in RAM, and
/// touches the stack that the loop will use, so that no page fault delays it; keeps the processors from sleeping deeply
/// as long as the process lives, where the kernel lets it (/dev/cpu_dma_latency, root).
/// @throws link::LinkError with what to do, if this user may not have the priority or lock memory.
void become_real_time(int priority);

}  // namespace meltbench::runtime
