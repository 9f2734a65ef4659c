#include "engine/support/confinement.h"

#include <fmt/format.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <stdexcept>
#include <vector>

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
    throw std::runtime_error(fmt::format("its reader can't limit its {}: {}", name, std::strerror(errno)));
}

// Addresses in use, most of them of libraries: the first field of /proc/self/statm is in pages.
std::size_t addresses_in_use() {
  std::size_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  return pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
}

#if defined(__x86_64__) || defined(__aarch64__)

#ifdef __x86_64__
constexpr std::uint32_t kArchitecture = AUDIT_ARCH_X86_64;
#else
constexpr std::uint32_t kArchitecture = AUDIT_ARCH_AARCH64;
#endif

// What memory, the clock, the two pipes and the end of a process take.
constexpr std::uint32_t kAllowed[] = {
    SYS_read,
    SYS_write,
    SYS_writev,
    SYS_close,
    SYS_fstat,
    SYS_lseek,
    SYS_mmap,
    SYS_munmap,
    SYS_mremap,
    SYS_mprotect,
    SYS_madvise,
    SYS_brk,
    SYS_futex,
    SYS_sched_yield,
    SYS_getrandom,
    SYS_clock_gettime,
    SYS_gettimeofday,
    SYS_getpid,
    SYS_gettid,
    SYS_tgkill,
    SYS_rt_sigaction,
    SYS_rt_sigprocmask,
    SYS_rt_sigreturn,
    SYS_exit,
    SYS_restart_syscall,
    SYS_exit_group,
};

// Files, connections, programs, other processes: nobody who asks for these is reading a mesh.
constexpr std::uint32_t kDeadly[] = {
#ifdef __x86_64__
    SYS_open,     SYS_creat,   SYS_fork,   SYS_vfork,
#endif
    SYS_openat,   SYS_openat2, SYS_socket, SYS_connect, SYS_execve,
    SYS_execveat, SYS_clone,   SYS_clone3, SYS_ptrace,  SYS_kill,
};

// A program for the kernel's filter: load a field, compare and jump, answer.
void filter_system_calls() {
  constexpr auto kLoad = BPF_LD | BPF_W | BPF_ABS;
  constexpr auto kIfEqual = BPF_JMP | BPF_JEQ | BPF_K;
  constexpr auto kAnswer = BPF_RET | BPF_K;
  std::vector<sock_filter> program{
      BPF_STMT(kLoad, offsetof(seccomp_data, arch)),
      BPF_JUMP(kIfEqual, kArchitecture, 1, 0),
      BPF_STMT(kAnswer, SECCOMP_RET_KILL_PROCESS),
      BPF_STMT(kLoad, offsetof(seccomp_data, nr)),
  };
  const auto answer_for = [&](std::uint32_t call, std::uint32_t what) {
    program.push_back(BPF_JUMP(kIfEqual, call, 0, 1));
    program.push_back(BPF_STMT(kAnswer, what));
  };
  for (const std::uint32_t call : kAllowed) answer_for(call, SECCOMP_RET_ALLOW);
  for (const std::uint32_t call : kDeadly) answer_for(call, SECCOMP_RET_KILL_PROCESS);
  program.push_back(BPF_STMT(kAnswer, SECCOMP_RET_ERRNO | EPERM));
  const sock_fprog whole{static_cast<unsigned short>(program.size()), program.data()};
  // Where it isn't built into the kernel, limits and the process's own end are what is left.
  if (::prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0) ::prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &whole);
}

#else
void filter_system_calls() {}
#endif

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
