#pragma once

namespace meltbench::runtime {

/// Gives the calling thread a SCHED_FIFO priority, 1..99: it then runs before everything of a lower one.
/// @throws link::LinkError with what to do, if this user may not have it.
void take_priority(int priority);

/// Keeps all memory of this process, also what it gets later, in RAM, and touches the stack that a loop will use: no
/// page fault can then delay it.
/// @throws link::LinkError with what to do, if this user may not lock so much.
void lock_memory();

}  // namespace meltbench::runtime
