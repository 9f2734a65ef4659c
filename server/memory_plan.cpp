#include "server/memory_plan.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <stdexcept>

namespace selenograph::server {
namespace {

constexpr std::size_t kMostByDefaultMb = 8192;
// A body that is only half there keeps nobody's frame waiting.
constexpr std::size_t kPartOfBodies = 8;

// cgroups(7): "0::/path" names the group of version 2, whose limit and those of the groups above it hold; "max" is
// none.
std::size_t control_group_limit_mb() {
  std::size_t least = SIZE_MAX;
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    if (!line.starts_with("0::/")) continue;
    for (std::string path = line.substr(3);; path = path.substr(0, path.rfind('/'))) {
      std::size_t bytes = 0;
      if (std::ifstream("/sys/fs/cgroup" + path + "/memory.max") >> bytes) least = std::min(least, bytes >> 20);
      if (path.empty()) break;
    }
  }
  // Version 1, as seen from inside a container.
  std::size_t bytes = 0;
  if (std::ifstream("/sys/fs/cgroup/memory/memory.limit_in_bytes") >> bytes) least = std::min(least, bytes >> 20);
  return least;
}

}  // namespace

std::size_t machine_memory_mb() {
  const auto pages = static_cast<std::size_t>(::sysconf(_SC_PHYS_PAGES)),
             page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  rlimit addresses{};
  const std::size_t allowed =
      ::getrlimit(RLIMIT_AS, &addresses) == 0 && addresses.rlim_cur != RLIM_INFINITY ? addresses.rlim_cur : SIZE_MAX;
  return std::min({(pages * page) >> 20, control_group_limit_mb(), allowed >> 20});
}

std::size_t default_memory_mb(std::size_t machine_mb, const MemorySettings& s) {
  return std::max(std::min(kMostByDefaultMb, machine_mb / 4 * 3), s.cache_mb + s.scene_mb + s.mesh_mb + kOwnMb + 1024);
}

MemoryPlan plan_memory(const MemorySettings& s, std::size_t machine_mb) {
  const std::size_t total_mb = s.memory_mb > 0 ? s.memory_mb : default_memory_mb(machine_mb, s);
  const std::size_t kept_mb = s.cache_mb + s.scene_mb + s.mesh_mb;
  const std::size_t least_mb = kept_mb + kOwnMb + kLeastForRequestsMb;
  if (total_mb < least_mb)
    throw std::runtime_error(
        fmt::format("--memory-mb {} is too little: --cache-mb {}, --scene-mb {} and --mesh-mb {} are parts of it, the "
                    "program takes "
                    "{} and requests at least {}, {} together",
                    total_mb, s.cache_mb, s.scene_mb, s.mesh_mb, kOwnMb, kLeastForRequestsMb, least_mb));
  const std::size_t rest_mb = total_mb - kept_mb - kOwnMb, bodies_mb = rest_mb / kPartOfBodies;
  return {total_mb << 20, (rest_mb - bodies_mb) << 20, bodies_mb << 20};
}

}  // namespace selenograph::server
