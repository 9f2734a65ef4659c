#include "server/service/memory_plan.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <stdexcept>

#include "dem/terrain/terrain.h"
#include "engine/renderer.h"
#include "engine/visibility/meshes/mesh_reader.h"

namespace selenograph::server {
namespace {

constexpr std::size_t kMostByDefaultMb = 8192;
constexpr std::size_t kEnoughForRequestsMb = 1024;
// A body that is only half there keeps nobody's frame waiting.
constexpr std::size_t kPartOfBodies = 8;

// The least limit of a control group and those above it, in bytes. "max", in version 2, is none. Inside a container the
// root is what the container has, and the path may not be there.
std::size_t least_limit(const std::string& root, std::string path, const char* file) {
  std::size_t least = SIZE_MAX;
  for (;; path = path.substr(0, path.rfind('/'))) {
    std::size_t bytes = 0;
    if (std::ifstream(root + path + "/" + file) >> bytes) least = std::min(least, bytes);
    if (path.empty()) return least;
  }
}

// cgroups(7): "0::/path" names the group of version 2, "4:memory:/path" that of version 1.
std::size_t control_group_limit_mb() {
  std::size_t least = SIZE_MAX;
  std::ifstream groups("/proc/self/cgroup");
  for (std::string line; std::getline(groups, line);) {
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos || line.compare(second + 1, 1, "/") != 0) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1), path = line.substr(second + 1);
    if (controllers.empty())
      least = std::min(least, least_limit("/sys/fs/cgroup", path, "memory.max"));
    else if (("," + controllers + ",").find(",memory,") != std::string::npos)
      least = std::min(least, least_limit("/sys/fs/cgroup/memory", path, "memory.limit_in_bytes"));
  }
  return least >> 20;
}

std::size_t less(std::size_t a, std::size_t b) { return a - std::min(a, b); }

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
  const std::size_t asked_mb = s.cache_mb.value_or(0) + s.scene_mb.value_or(0) + s.mesh_mb.value_or(0);
  const std::size_t own_mb = kOwnMb + (s.remote_tiles ? kSecondBuildMb : 0);
  const std::size_t by_default_mb = std::min(
      machine_mb / 4 * 3, std::max(kMostByDefaultMb, asked_mb > 0 ? asked_mb + own_mb + kEnoughForRequestsMb : 0));
  MemoryParts parts{.total_mb = s.memory_mb > 0 ? s.memory_mb : by_default_mb, .own_mb = own_mb};
  const std::size_t rest_mb = less(parts.total_mb, own_mb);
  std::size_t left_mb = less(rest_mb - std::min(rest_mb / 2, kEnoughForRequestsMb), asked_mb);
  const auto share_out = [&](const std::optional<std::size_t>& asked, std::size_t most_mb, std::size_t here_mb) {
    if (asked) return *asked;
    const std::size_t share_mb = std::max(kLeastPartMb, std::min(most_mb, here_mb));
    left_mb = less(left_mb, share_mb);
    return share_mb;
  };
  const std::size_t others = (s.cache_mb ? 0 : 1) + (s.mesh_mb ? 0 : 1);
  const std::size_t for_others_mb = others * std::min<std::size_t>(64, left_mb / 4);
  parts.scene_mb = share_out(s.scene_mb, engine::RendererOptions{}.scene_bytes >> 20, left_mb - for_others_mb);
  parts.mesh_mb = share_out(s.mesh_mb, engine::MeshReaderOptions{}.max_bytes >> 20, left_mb / (s.cache_mb ? 1 : 4));
  parts.cache_mb = share_out(s.cache_mb, dem::TerrainOptions{}.cache_bytes >> 20, left_mb);
  return parts;
}

MemoryPlan plan_memory(const MemoryParts& p) {
  const std::size_t kept_mb = p.cache_mb + p.scene_mb + p.mesh_mb, least_mb = kept_mb + p.own_mb + kLeastForRequestsMb;
  if (p.total_mb < least_mb)
    throw std::runtime_error(
        fmt::format("--memory-mb {} is too little: --cache-mb {}, --scene-mb {} and --mesh-mb {} are parts of it, the "
                    "program takes {} and requests at least {}, {} together",
                    p.total_mb, p.cache_mb, p.scene_mb, p.mesh_mb, p.own_mb, kLeastForRequestsMb, least_mb));
  const std::size_t rest_mb = p.total_mb - kept_mb - p.own_mb, bodies_mb = rest_mb / kPartOfBodies;
  return {p.total_mb << 20, (rest_mb - bodies_mb) << 20, bodies_mb << 20};
}

}  // namespace selenograph::server
