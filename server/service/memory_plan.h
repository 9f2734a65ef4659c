// Division of the process's memory: caches, scenes, requests.
//
//   |<----------------------------- total_mb ----------------------------->|
//   | own_mb | cache_mb | scene_mb | mesh_mb | requests, 7/8 | bodies, 1/8 |
//     program  terrain                         work, answers   being received
#pragma once

#include <cstddef>
#include <optional>
#include <string>

namespace selenograph::server {

// Memory by the options, MiB.
struct MemorySettings {
  std::size_t memory_mb = 0;              // total; 0: a share of the machine's memory
  std::optional<std::size_t> cache_mb{};  // terrain blocks and pyramids; empty: as much as fits
  std::optional<std::size_t>
      scene_mb{};                        // acceleration structures: limit of one frame and of those kept between frames
  std::optional<std::size_t> mesh_mb{};  // object meshes: the one being read and the cached ones
  bool remote_tiles = false;             // remote tiles may be read: adds kSecondBuildMb
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

// Memory for the program, its threads' stacks, one pyramid being built, and maps.
inline constexpr std::size_t kOwnMb = 512;
// Memory for a second pyramid being built, from remote tiles.
inline constexpr std::size_t kSecondBuildMb = 160;
inline constexpr std::size_t kMinForRequestsMb = 64;
// Minimum of a part that no option sets.
inline constexpr std::size_t kMinPartMb = 16;

// Returns the machine's memory, limited by the process's control group and by RLIMIT_AS. MiB.
std::size_t machine_memory_mb();

// Divides the memory into parts. Without --memory-mb the total is three quarters of the machine's memory, limited to
// 8192 (enough for a request of the default limits beside small ones) or, if more, to the sum of the options plus
// own_mb plus 1024. Parts that no option sets get 1024 each if that leaves 1024, or half of the rest, to requests.
// Otherwise scenes take precedence: frames fail without their memory, whereas small caches only cost time. Of a total
// of 2048 they get 640, where equal shares would leave them 256.
MemoryParts memory_parts(const MemorySettings& settings, std::size_t machine_mb = machine_memory_mb());

// Returns the memory left to requests. Throws std::runtime_error naming the options when the parts exceed the total.
MemoryPlan plan_memory(const MemoryParts& parts);

}  // namespace selenograph::server
