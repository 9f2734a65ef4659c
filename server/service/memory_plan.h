// Division of the process's memory: caches, scenes, requests.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace selenograph::server {

// MiB, as the options give them.
struct MemorySettings {
  std::size_t memory_mb = 0;              // for everything; 0: from the machine's memory
  std::optional<std::size_t> cache_mb{};  // terrain blocks and pyramids; empty: what fits
  std::optional<std::size_t> scene_mb{};  // acceleration structures: of one frame at most, and kept between frames
  std::optional<std::size_t> mesh_mb{};   // object meshes: reading one, and the cached ones
  bool remote_tiles = false;              // remote tiles may be read: adds kSecondBuildMb
};

struct MemoryParts {
  std::size_t total_mb = 0, cache_mb = 0, scene_mb = 0, mesh_mb = 0;
  std::size_t own_mb = 0;  // reserved for the process itself
};

struct MemoryPlan {
  std::size_t total_bytes = 0;
  std::size_t requests_bytes = 0;  // active frames and answers not yet sent
  std::size_t bodies_bytes = 0;    // bodies being received
};

// The program, its threads' stacks, one pyramid being built, and maps.
inline constexpr std::size_t kOwnMb = 512;
// Another pyramid being built, from remote tiles.
inline constexpr std::size_t kSecondBuildMb = 160;
// Requests get at least this much.
inline constexpr std::size_t kLeastForRequestsMb = 64;
// A part that no option names is at least this large.
inline constexpr std::size_t kLeastPartMb = 16;

// Memory of the machine, limited by the process's control group and by RLIMIT_AS. MiB.
std::size_t machine_memory_mb();

// Without --memory-mb the total is three quarters of the machine's memory, at most 8192 (enough for a request of the
// default limits and small ones beside it) or, if more, what the options ask for plus own_mb plus 1024. Parts that no
// option sets get 1024 each if that leaves 1024, or half of the rest, to requests. If not, scenes take precedence: the
// others only cost time when they are small.
MemoryParts memory_parts(const MemorySettings& settings, std::size_t machine_mb = machine_memory_mb());

// Throws std::runtime_error naming the options when the parts exceed the total.
MemoryPlan plan_memory(const MemoryParts& parts);

}  // namespace selenograph::server
