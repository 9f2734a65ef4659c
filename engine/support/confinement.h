// Restrictions on a process that works on untrusted data.
#pragma once

#include <cstddef>

namespace selenograph::engine {

// Confines this process permanently: `memory_bytes` above its present use, `seconds` of processor time, no core file,
// first to be killed if the machine runs out of memory, killed if its parent ends. Builds with sanitizers apply only
// the limit of processor time. Throws std::runtime_error if a limit cannot be set.
void confine(std::size_t memory_bytes, unsigned seconds);

}  // namespace selenograph::engine
