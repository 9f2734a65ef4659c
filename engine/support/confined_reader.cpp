#include "engine/support/confined_reader.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <new>
#include <utility>
#include <vector>

#include "dem/base/cache.h"
#include "dem/base/error.h"
#include "dem/files/open_file.h"

namespace selenograph::engine {
namespace {

constexpr int kRead = 0, kRefused = 3, kOutOfMemory = 4;  // exit statuses of the child
constexpr rlim_t kProcessorTime_s = 20;

// Child process that writes to a pipe. The destructor ends it.
struct Child {
  Child() = default;
  ~Child() {
    if (process > 0) ::kill(process, SIGKILL);
    wait();
    ::close(pipe[0]);
    ::close(pipe[1]);
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  // Returns the exit status, or the negative number of the signal that ended the child.
  int wait() {
    int status = 0;
    while (process > 0 && ::waitpid(process, &status, 0) < 0 && errno == EINTR) continue;
    process = -1;
    return WIFSIGNALED(status) ? -WTERMSIG(status) : WEXITSTATUS(status);
  }

  pid_t process = -1;
  int pipe[2] = {-1, -1};  // ends for reading and writing
};

// Starts a program that inherits the standard streams only; its error stream is discarded. Returns errno.
int start(const std::string& program, const char* command, const std::string& path, std::size_t max_bytes,
          Child& child) {
  if (::pipe2(child.pipe, O_CLOEXEC) != 0) return errno;
  const std::string words[] = {program, command, path, std::to_string(max_bytes)};
  char* arguments[std::size(words) + 1] = {};
  std::ranges::transform(words, arguments, [](const std::string& word) { return const_cast<char*>(word.c_str()); });
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, child.pipe[1], STDOUT_FILENO);
  posix_spawn_file_actions_addopen(&files, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO + 1);
  const int error = ::posix_spawn(&child.process, arguments[0], &files, nullptr, arguments, environ);
  posix_spawn_file_actions_destroy(&files);
  ::close(std::exchange(child.pipe[1], -1));  // otherwise the pipe would never end
  return error;
}

// Returns all bytes up to the pipe's end.
std::string read_all(int pipe, const StopToken& stop) {
  std::string answer;
  std::vector<char> bytes(1 << 16);
  for (;;) {
    stop.check();
    pollfd readable{pipe, POLLIN, 0};
    if (::poll(&readable, 1, static_cast<int>(dem::kPollInterval.count())) <= 0) continue;
    const ssize_t count = ::read(pipe, bytes.data(), bytes.size());
    if (count <= 0) return answer;
    answer.append(bytes.data(), static_cast<std::size_t>(count));
  }
}

// Lowers a limit of this process.
void limit(__rlimit_resource resource, rlim_t max) {
  rlimit limits{};
  ::getrlimit(resource, &limits);
  limits.rlim_cur = std::min(limits.rlim_max, max);
  ::setrlimit(resource, &limits);
}

void confine([[maybe_unused]] std::size_t memory_bytes) {
  // Ignore what a terminal or a supervisor sends to all processes: the parent decides when the child ends.
  for (const int signal : {SIGTERM, SIGINT, SIGHUP}) ::signal(signal, SIG_IGN);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  std::ofstream("/proc/self/oom_score_adj") << 1000;  // if the machine runs out of memory, end this process first
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_CPU, kProcessorTime_s);
#ifdef SELENOGRAPH_JEMALLOC  // not with sanitizers, which reserve terabytes of addresses
  // Count from the address space in use, most of it libraries. The file's first number counts pages.
  std::size_t pages = 0;
  std::ifstream("/proc/self/statm") >> pages;
  limit(RLIMIT_AS, pages * static_cast<std::size_t>(::sysconf(_SC_PAGESIZE)) + memory_bytes);
#endif
}

// Ends the process without destructors: a library that read a damaged file may have left damaged objects.
[[noreturn]] void finish(int status, const std::string& answer) {
  ::_exit(dem::write_all(STDOUT_FILENO, answer) == 0 ? status : EXIT_FAILURE);
}

}  // namespace

std::string ConfinedReader::read(const char* command, const std::string& path, const StopToken& stop) const {
  if (options_.program.empty()) throw DataError(path, "no program is set up to read it");
  std::unique_lock lock(mutex_, std::defer_lock);
  while (!lock.try_lock_for(dem::kPollInterval)) stop.check();
  Child child;
  if (const int error = start(options_.program, command, path, options_.max_bytes, child))
    throw SystemFault(path, error, fmt::format("no reader can be started: {}", std::strerror(error)));
  std::string answer = read_all(child.pipe[0], stop);
  const int status = child.wait();
  if (status == kRead) return answer;
  if (status == kRefused) throw DataError(path, answer.substr(0, 1000));
  if (status == kOutOfMemory)
    throw DataError(path, fmt::format("takes more than {} MiB to read (--mesh-mb)", options_.max_bytes >> 20));
  throw DataError(path, fmt::format("cannot be read: its reader ended with {}",
                                    status < 0 ? ::strsignal(-status) : fmt::format("status {}", status)));
}

int read_in_child(int argc, char** argv, const ParseFile& parse) {
  if (argc != 4) return EXIT_FAILURE;
  std::set_new_handler([] { ::_exit(kOutOfMemory); });
  try {
    const std::size_t max_bytes = std::strtoull(argv[3], nullptr, 10);
    confine(max_bytes);
    finish(kRead, parse(argv[2], max_bytes));
  } catch (const DataError& e) {
    finish(kRefused, e.what_is_wrong());
  } catch (const std::exception& e) {
    finish(kRefused, e.what());
  }
}

}  // namespace selenograph::engine
