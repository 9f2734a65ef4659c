#include "server/service/memory_plan.h"

#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <stdexcept>

namespace selenograph::server {
namespace {

constexpr std::size_t kMaxByDefaultMb = 8192;  // of the total without --memory-mb
constexpr std::size_t kMinPartMb = 16, kMaxPartMb = 1024;

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

MemoryPlan plan_memory(const MemorySettings& s, std::size_t machine_mb) {
  const std::size_t set_mb = s.cache_mb.value_or(0) + s.scene_mb.value_or(0) + s.mesh_mb.value_or(0);
  const std::size_t by_default_mb = std::min(machine_mb / 4 * 3, std::max(kMaxByDefaultMb, kOwnMb + 2 * set_mb));
  MemoryPlan plan{.total_mb = s.memory_mb > 0 ? s.memory_mb : by_default_mb};
  const std::size_t left_mb = difference_or_0(plan.total_mb, kOwnMb + set_mb);
  const auto share = [&](const std::optional<std::size_t>& option, std::size_t eighths) {
    return option.value_or(std::clamp(left_mb / 8 * eighths, kMinPartMb, kMaxPartMb));
  };
  plan.scene_mb = share(s.scene_mb, 3);
  plan.cache_mb = share(s.cache_mb, 1);
  plan.mesh_mb = share(s.mesh_mb, 1);
  plan.requests_mb = difference_or_0(plan.total_mb, kOwnMb + plan.cache_mb + plan.scene_mb + plan.mesh_mb);
  return plan;
}

void require_memory_for_requests(const MemoryPlan& p) {
  if (p.requests_mb >= kMinForRequestsMb) return;
  throw std::runtime_error(
      fmt::format("--memory-mb {} is too little: --cache-mb {}, --scene-mb {} and --mesh-mb {} are parts of it, the "
                  "program takes {} and requests at least {}, {} together",
                  p.total_mb, p.cache_mb, p.scene_mb, p.mesh_mb, kOwnMb, kMinForRequestsMb,
                  p.cache_mb + p.scene_mb + p.mesh_mb + kOwnMb + kMinForRequestsMb));
}

}  // namespace selenograph::server
