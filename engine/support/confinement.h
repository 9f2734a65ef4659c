// What a process can still do that works on data which nobody trusts.
#pragma once

#include <cstddef>

namespace selenograph::engine {

// Confines this process, for good: `memory_bytes` more than it has by now, `seconds` of processor time, no core file,
// first to go when the machine is out of memory, gone when its parent is. From now on the kernel refuses what
// computing doesn't need, and ends the process that opens a file or a connection or starts a program (seccomp). Of
// these, builds with sanitizers keep the processor time alone. Throws std::runtime_error when a limit can't be set; a
// kernel without seccomp is no error.
void confine(std::size_t memory_bytes, unsigned seconds);

}  // namespace selenograph::engine
