#include "engine/support/confinement.h"

#include <fmt/format.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <stdexcept>

#include "engine/support/child_process.h"

namespace selenograph::engine {
namespace {

// Sets a resource limit. `grace`: margin of the hard limit above the soft one. The soft limit's signal tells the
// reason; the hard limit's kills.
void set_limit(int resource, std::size_t max, const char* name, std::size_t grace = 0) {
  rlimit limit{};
  ::getrlimit(static_cast<__rlimit_resource>(resource), &limit);
  limit.rlim_max = std::min<rlim_t>(limit.rlim_max, max + grace);
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, max);
  if (::setrlimit(static_cast<__rlimit_resource>(resource), &limit) != 0)
    throw std::runtime_error(fmt::format("its reader cannot limit its {}: {}", name, std::strerror(errno)));
}

// Returns the address space in use, most of it libraries, bytes. The first field of /proc/self/statm counts pages.
std::size_t addresses_in_use() {
  std::size_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

}  // namespace

void confine(std::size_t memory_bytes, unsigned seconds) {
  set_limit(RLIMIT_CPU, seconds, "processor time", 1);
  if (kSanitized) return;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::ofstream("/proc/self/oom_score_adj") << 1000;
  set_limit(RLIMIT_CORE, 0, "core file");
  set_limit(RLIMIT_AS, addresses_in_use() + memory_bytes, "memory");
}

}  // namespace selenograph::engine
