#include "engine/support/confinement.h"

#include <fmt/format.h>
#include <seccomp.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstring>
#include <fstream>
#include <memory>
#include <stdexcept>

#include "engine/support/child_process.h"

namespace selenograph::engine {
namespace {

// `grace`: between the signal that says why and the one that ends it.
void set_limit(int resource, std::size_t most, const char* name, std::size_t grace = 0) {
  rlimit limit{};
  ::getrlimit(static_cast<__rlimit_resource>(resource), &limit);
  limit.rlim_max = std::min<rlim_t>(limit.rlim_max, most + grace);
  limit.rlim_cur = std::min<rlim_t>(limit.rlim_max, most);
  if (::setrlimit(static_cast<__rlimit_resource>(resource), &limit) != 0)
    throw std::runtime_error(fmt::format("its reader cannot limit its {}: {}", name, std::strerror(errno)));
}

// Addresses in use, most of them of libraries: the first field of /proc/self/statm is in pages.
std::size_t addresses_in_use() {
  std::size_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

// What memory, the clock, the two pipes and the end of a process take.
constexpr int kAllowed[] = {
    SCMP_SYS(read),
    SCMP_SYS(write),
    SCMP_SYS(writev),
    SCMP_SYS(close),
    SCMP_SYS(fstat),
    SCMP_SYS(lseek),
    SCMP_SYS(mmap),
    SCMP_SYS(munmap),
    SCMP_SYS(mremap),
    SCMP_SYS(mprotect),
    SCMP_SYS(madvise),
    SCMP_SYS(brk),
    SCMP_SYS(futex),
    SCMP_SYS(sched_yield),
    SCMP_SYS(getrandom),
    SCMP_SYS(clock_gettime),
    SCMP_SYS(gettimeofday),
    SCMP_SYS(getpid),
    SCMP_SYS(gettid),
    SCMP_SYS(tgkill),
    SCMP_SYS(rt_sigaction),
    SCMP_SYS(rt_sigprocmask),
    SCMP_SYS(rt_sigreturn),
    SCMP_SYS(exit),
    SCMP_SYS(restart_syscall),
    SCMP_SYS(exit_group),
};

// Files, connections, programs, other processes: nobody who asks for these is reading a mesh. (Architectures that don't
// have one of these calls ignore its rule.)
constexpr int kDeadly[] = {
    SCMP_SYS(open),    SCMP_SYS(creat),  SCMP_SYS(fork),    SCMP_SYS(vfork),  SCMP_SYS(openat),
    SCMP_SYS(openat2), SCMP_SYS(socket), SCMP_SYS(connect), SCMP_SYS(execve), SCMP_SYS(execveat),
    SCMP_SYS(clone),   SCMP_SYS(clone3), SCMP_SYS(ptrace),  SCMP_SYS(kill),
};

// Where the kernel has no seccomp, limits and the process's own end are what is left.
void filter_system_calls() {
  const std::unique_ptr<void, decltype(&::seccomp_release)> filter(::seccomp_init(SCMP_ACT_ERRNO(EPERM)),
                                                                   &::seccomp_release);
  bool good = filter && ::seccomp_attr_set(filter.get(), SCMP_FLTATR_ACT_BADARCH, SCMP_ACT_KILL_PROCESS) == 0;
  for (const int call : kAllowed) good = good && ::seccomp_rule_add(filter.get(), SCMP_ACT_ALLOW, call, 0) == 0;
  for (const int call : kDeadly) good = good && ::seccomp_rule_add(filter.get(), SCMP_ACT_KILL_PROCESS, call, 0) == 0;
  if (good) ::seccomp_load(filter.get());
}

}  // namespace

void confine(std::size_t memory_bytes, unsigned seconds) {
  set_limit(RLIMIT_CPU, seconds, "processor time", 1);
  if (kSanitized) return;
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::ofstream("/proc/self/oom_score_adj") << 1000;
  set_limit(RLIMIT_CORE, 0, "core file");
  set_limit(RLIMIT_AS, addresses_in_use() + memory_bytes, "memory");
  filter_system_calls();
}

}  // namespace selenograph::engine
