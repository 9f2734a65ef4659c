// Division of the process's memory: a budget for each kind of cache, and one for requests.
//
//   |<----------------------------- total_mb ---------------------------->|
//   | kOwnMb  | cache_mb | scene_mb | mesh_mb |         requests_mb        |
//     program   terrain                         work, answers not yet sent
#pragma once

#include <cstddef>
#include <optional>

namespace selenograph::server {

// Memory by the options, MiB. Empty parts get a share.
struct MemorySettings {
  std::size_t memory_mb = 0;              // total; 0: a share of the machine's memory
  std::optional<std::size_t> cache_mb{};  // terrain blocks and pyramids
  std::optional<std::size_t> scene_mb{};  // acceleration structures: of one frame, and of those kept between frames
  std::optional<std::size_t> mesh_mb{};   // object meshes: the one being read and the cached ones
};

struct MemoryPlan {
  std::size_t total_mb = 0, cache_mb = 0, scene_mb = 0, mesh_mb = 0;
  std::size_t requests_mb = 0;  // 0: the parts exceed the total
};

// Memory for the program, its threads' stacks, pyramids being built, and maps.
inline constexpr std::size_t kOwnMb = 512;
inline constexpr std::size_t kMinForRequestsMb = 64;

// Returns the machine's memory, limited by the process's control group and by RLIMIT_AS. MiB.
std::size_t machine_memory_mb();

// Divides the memory. Without --memory-mb the total is three quarters of the machine's memory, at most 8192 (enough for
// a request of the default limits beside small ones) or, if more, kOwnMb and twice the sum of the options. Of what
// kOwnMb and the options leave, scenes get three eighths, terrain and meshes an eighth each, at most 1024 each, and
// requests the rest: frames fail without their scenes, whereas small caches only cost time.
MemoryPlan plan_memory(const MemorySettings& settings, std::size_t machine_mb = machine_memory_mb());

// Throws std::runtime_error naming the options when less than kMinForRequestsMb is left to requests.
void require_memory_for_requests(const MemoryPlan& plan);

}  // namespace selenograph::server
