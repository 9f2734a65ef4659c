// How the service's memory is shared out: caches, scenes, what requests hold.
#pragma once

#include <cstddef>
#include <string>

namespace selenograph::server {

// MiB, as the options give them.
struct MemorySettings {
  std::size_t memory_mb = 0;  // for everything; 0: see default_memory_mb()
  std::size_t cache_mb = 0;   // terrain blocks and pyramids
  std::size_t scene_mb = 0;   // acceleration structures and what frames are drawn with
  std::size_t mesh_mb = 0;    // objects' meshes
};

struct MemoryPlan {
  std::size_t total_bytes = 0;
  std::size_t requests_bytes = 0;  // frames in work and answers not yet sent
  std::size_t bodies_bytes = 0;    // bodies being received
};

// The program itself, its threads' stacks, one pyramid that is being built, and maps.
inline constexpr std::size_t kOwnMb = 512;
// Requests get at least this much.
inline constexpr std::size_t kLeastForRequestsMb = 64;

// Without --memory-mb: three quarters of what there is, at most 8192: that serves a request of the default limits
// and small ones beside it. Never less than the caches and scenes ask for and 1024 more.
std::size_t default_memory_mb(std::size_t machine_mb, const MemorySettings& settings);

// Of the machine, of the control group that the process is in, or RLIMIT_AS: the least. MiB.
std::size_t machine_memory_mb();

// Throws std::runtime_error naming the options when the parts don't fit into the whole.
MemoryPlan plan_memory(const MemorySettings& settings, std::size_t machine_mb);

}  // namespace selenograph::server
