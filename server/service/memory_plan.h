// How the process's memory is shared out: caches, scenes, what requests hold.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace selenograph::server {

// MiB, as the options give them.
struct MemorySettings {
  std::size_t memory_mb = 0;              // for everything; 0: by what there is
  std::optional<std::size_t> cache_mb{};  // terrain blocks and pyramids; nothing: what fits, as of the others
  std::optional<std::size_t> scene_mb{};  // acceleration structures: of one frame at most, and kept between frames
  std::optional<std::size_t> mesh_mb{};   // objects' meshes: to read one, and kept
  bool remote_tiles = false;              // may be read: what is made of them has a builder of its own
};

struct MemoryParts {
  std::size_t total_mb = 0, cache_mb = 0, scene_mb = 0, mesh_mb = 0;
  std::size_t own_mb = 0;  // nobody's part
};

struct MemoryPlan {
  std::size_t total_bytes = 0;
  std::size_t requests_bytes = 0;  // frames in work and answers not yet sent
  std::size_t bodies_bytes = 0;    // bodies being received
};

// The program itself, its threads' stacks, one pyramid that is being built, and maps.
inline constexpr std::size_t kOwnMb = 512;
// Another pyramid that is being built, of tiles on a network.
inline constexpr std::size_t kSecondBuildMb = 160;
// Requests get at least this much.
inline constexpr std::size_t kLeastForRequestsMb = 64;
// A part that no option names is at least this large.
inline constexpr std::size_t kLeastPartMb = 16;

// Of the machine, of the control group that the process is in, or RLIMIT_AS: the least. MiB.
std::size_t machine_memory_mb();

// Without --memory-mb the whole is three quarters of what there is, at most 8192, which serve a request of the default
// limits and small ones beside it, or what the options ask for and 1024 more. Parts that no option names have 1024 each
// where that leaves as much, or half, to requests. Where it doesn't, scenes come first: the others only cost time when
// they are small.
MemoryParts memory_parts(const MemorySettings& settings, std::size_t machine_mb = machine_memory_mb());

// Throws std::runtime_error naming the options when the parts don't fit into the whole.
MemoryPlan plan_memory(const MemoryParts& parts);

}  // namespace selenograph::server
