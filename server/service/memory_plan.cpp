#include "server/service/memory_plan.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include "dem/terrain/terrain.h"
#include "engine/renderer.h"
#include "engine/support/confined_reader.h"

namespace selenograph::server {
namespace {

constexpr std::size_t kMaxByDefaultMb = 8192;       // of the total without --memory-mb
constexpr std::size_t kEnoughForRequestsMb = 1024;  // left to requests by parts that no option sets
// Bodies being received get an eighth of the requests' memory, so that slow senders cannot keep frames from theirs.
constexpr std::size_t kBodyShare = 8;

// Returns the smallest limit of a control group and the groups above it, in bytes. Version 2 writes "max" for no limit.
// Inside a container only the root may exist: it is the container's own group.
std::size_t smallest_limit(const std::string& root, std::string path, const char* file) {
  std::size_t smallest = SIZE_MAX;
  for (;; path = path.substr(0, path.rfind('/'))) {
    std::size_t bytes = 0;
    if (std::ifstream(root + path + "/" + file) >> bytes) smallest = std::min(smallest, bytes);
    if (path.empty()) return smallest;
  }
}

// Returns the memory limit of the process's control groups, MiB. In /proc/self/cgroup (cgroups(7)), "0::/path" names
// the group of version 2, and "4:memory:/path" the group of version 1.
std::size_t control_group_limit_mb() {
  std::size_t smallest = SIZE_MAX;
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos || line.compare(second + 1, 1, "/") != 0) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1), path = line.substr(second + 1);
    if (controllers.empty())
      smallest = std::min(smallest, smallest_limit("/sys/fs/cgroup", path, "memory.max"));
    else if (("," + controllers + ",").find(",memory,") != std::string::npos)
      smallest = std::min(smallest, smallest_limit("/sys/fs/cgroup/memory", path, "memory.limit_in_bytes"));
  }
  return smallest >> 20;
}

// Returns a - b, and 0 for b > a.
std::size_t difference_or_0(std::size_t a, std::size_t b) { return a - std::min(a, b); }

}  // namespace

std::size_t machine_memory_mb() {
  const auto pages = static_cast<std::size_t>(::sysconf(_SC_PHYS_PAGES)),
             page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  rlimit addresses{};
  const std::size_t allowed =
      ::getrlimit(RLIMIT_AS, &addresses) == 0 && addresses.rlim_cur != RLIM_INFINITY ? addresses.rlim_cur : SIZE_MAX;
  return std::min({(pages * page) >> 20, control_group_limit_mb(), allowed >> 20});
}

MemoryParts memory_parts(const MemorySettings& s, std::size_t machine_mb) {
  const std::size_t set_mb = s.cache_mb.value_or(0) + s.scene_mb.value_or(0) + s.mesh_mb.value_or(0);
  const std::size_t own_mb = kOwnMb + (s.remote_tiles ? kSecondBuildMb : 0);
  const std::size_t by_default_mb =
      std::min(machine_mb / 4 * 3, std::max(kMaxByDefaultMb, set_mb > 0 ? set_mb + own_mb + kEnoughForRequestsMb : 0));
  MemoryParts parts{.total_mb = s.memory_mb > 0 ? s.memory_mb : by_default_mb, .own_mb = own_mb};
  const std::size_t rest_mb = difference_or_0(parts.total_mb, own_mb);
  // Memory for the parts that no option sets: half of the rest, or all but what is enough for requests.
  std::size_t left_mb = difference_or_0(rest_mb - std::min(rest_mb / 2, kEnoughForRequestsMb), set_mb);
  // Returns a part's option or, without one, its share of `available_mb`, which is then taken from `left_mb`.
  const auto share_out = [&](const std::optional<std::size_t>& option, std::size_t max_mb, std::size_t available_mb) {
    if (option) return *option;
    const std::size_t share_mb = std::max(kMinPartMb, std::min(max_mb, available_mb));
    left_mb = difference_or_0(left_mb, share_mb);
    return share_mb;
  };
  // Scenes come first, but leave to each other part 64 MiB, or a quarter if that is less. Meshes come next, with at
  // most a quarter of what is left, unless an option sets the terrain's part.
  const std::size_t other_parts = (s.cache_mb ? 0 : 1) + (s.mesh_mb ? 0 : 1);
  const std::size_t for_others_mb = other_parts * std::min<std::size_t>(64, left_mb / 4);
  parts.scene_mb = share_out(s.scene_mb, engine::RendererOptions{}.scene_bytes >> 20, left_mb - for_others_mb);
  parts.mesh_mb = share_out(s.mesh_mb, engine::ReaderOptions{}.max_bytes >> 20, left_mb / (s.cache_mb ? 1 : 4));
  parts.cache_mb = share_out(s.cache_mb, dem::TerrainOptions{}.cache_bytes >> 20, left_mb);
  return parts;
}

MemoryPlan plan_memory(const MemoryParts& p) {
  const std::size_t parts_mb = p.cache_mb + p.scene_mb + p.mesh_mb;
  const std::size_t min_mb = parts_mb + p.own_mb + kMinForRequestsMb;
  if (p.total_mb < min_mb)
    throw std::runtime_error(
        fmt::format("--memory-mb {} is too little: --cache-mb {}, --scene-mb {} and --mesh-mb {} are parts of it, the "
                    "program takes {} and requests at least {}, {} together",
                    p.total_mb, p.cache_mb, p.scene_mb, p.mesh_mb, p.own_mb, kMinForRequestsMb, min_mb));
  const std::size_t rest_mb = p.total_mb - parts_mb - p.own_mb;
  const std::size_t bodies_mb = rest_mb / kBodyShare;
  return {p.total_mb << 20, (rest_mb - bodies_mb) << 20, bodies_mb << 20};
}

}  // namespace selenograph::server
