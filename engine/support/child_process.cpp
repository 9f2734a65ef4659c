#include "engine/support/child_process.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <optional>
#include <thread>

#include "dem/files/open_file.h"

namespace selenograph::engine {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::chrono::milliseconds kPollInterval{20};  // interval at which waits check the limits and `stop`

std::string error_text(int error) { return std::strerror(error); }

class Descriptor {
 public:
  explicit Descriptor(int descriptor) : descriptor_(descriptor) {}
  ~Descriptor() { close(); }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;
  int get() const { return descriptor_; }
  void close() {
    if (descriptor_ >= 0) ::close(descriptor_);
    descriptor_ = -1;
  }

 private:
  int descriptor_;
};

// Settings of the child: it inherits only the three standard files, and gets its own process group and blocked signals,
// so that a signal from the terminal or a supervisor does not end it. This process ends it.
struct SpawnSettings {
  SpawnSettings(int input, int output) {
    posix_spawn_file_actions_init(&files);
    posix_spawn_file_actions_adddup2(&files, input, STDIN_FILENO);
    posix_spawn_file_actions_adddup2(&files, output, STDOUT_FILENO);
    if (!kSanitized) posix_spawn_file_actions_addopen(&files, STDERR_FILENO, "/dev/null", O_WRONLY, 0);
    posix_spawn_file_actions_addclosefrom_np(&files, STDERR_FILENO + 1);
    posix_spawnattr_init(&attributes);
    sigset_t blocked, all_signals;
    sigemptyset(&blocked);
    sigfillset(&all_signals);
    for (const int signal : {SIGTERM, SIGINT, SIGHUP}) sigaddset(&blocked, signal);
    posix_spawnattr_setsigmask(&attributes, &blocked);
    posix_spawnattr_setsigdefault(&attributes, &all_signals);
    posix_spawnattr_setpgroup(&attributes, 0);
    posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF | POSIX_SPAWN_SETPGROUP);
  }
  ~SpawnSettings() {
    posix_spawn_file_actions_destroy(&files);
    posix_spawnattr_destroy(&attributes);
  }
  SpawnSettings(const SpawnSettings&) = delete;
  SpawnSettings& operator=(const SpawnSettings&) = delete;

  posix_spawn_file_actions_t files;
  posix_spawnattr_t attributes;
};

// A running child process. The destructor kills it and waits for it.
class Child {
 public:
  Child(const std::string& program, const std::vector<std::string>& arguments, int input, int output) {
    const SpawnSettings settings(input, output);
    std::vector<char*> words{const_cast<char*>(program.c_str())};
    for (const std::string& word : arguments) words.push_back(const_cast<char*>(word.c_str()));
    words.push_back(nullptr);
    if (const int error =
            posix_spawn(&process_, program.c_str(), &settings.files, &settings.attributes, words.data(), environ))
      throw ChildFailed(fmt::format("cannot be started ({}: {})", program, error_text(error)));
  }
  ~Child() {
    if (process_ < 0) return;
    ::kill(process_, SIGKILL);
    int status;
    while (::waitpid(process_, &status, 0) < 0 && errno == EINTR) {
    }
  }
  Child(const Child&) = delete;
  Child& operator=(const Child&) = delete;

  // Returns the status from waitpid; empty while the child runs.
  std::optional<int> ended() {
    int status = 0;
    const pid_t found = ::waitpid(process_, &status, WNOHANG);
    if (found == 0 || (found < 0 && errno == EINTR)) return std::nullopt;
    process_ = -1;
    return status;
  }

 private:
  pid_t process_ = -1;
};

// Reads the answer from the child's pipe within the limits.
class Answer {
 public:
  Answer(int pipe, const ChildLimits& limits, const StopToken& stop)
      : pipe_(pipe), limits_(limits), stop_(stop), deadline_(Clock::now() + limits.time) {}

  // Returns the answer; empty if the pipe ended early.
  std::optional<std::string> read_all() const {
    std::uint64_t size = 0;
    if (!read_to(reinterpret_cast<char*>(&size), sizeof size)) return std::nullopt;
    if (size > limits_.output_bytes)
      throw ChildFailed(fmt::format("has an answer of {} bytes, more than {}", size, limits_.output_bytes));
    std::string bytes(size, '\0');
    if (!read_to(bytes.data(), bytes.size())) return std::nullopt;
    return bytes;
  }

  // Throws if the caller is cancelled or the time is over.
  void check() const {
    stop_.check();
    if (Clock::now() >= deadline_)
      throw ChildFailed(fmt::format("took more than {:g} s", std::chrono::duration<double>(limits_.time).count()));
  }

 private:
  // Reads `count` bytes. Returns false if the pipe has ended.
  bool read_to(char* to, std::size_t count) const {
    while (count > 0) {
      check();
      // Poll with a timeout, so that cancellation and the time limit are noticed.
      pollfd readable{pipe_, POLLIN, 0};
      if (::poll(&readable, 1, static_cast<int>(kPollInterval.count())) <= 0) continue;
      const ssize_t bytes_read = ::read(pipe_, to, std::min(count, std::size_t{1} << 20));
      if (bytes_read < 0 && (errno == EINTR || errno == EAGAIN)) continue;
      if (bytes_read <= 0) return false;
      to += bytes_read;
      count -= static_cast<std::size_t>(bytes_read);
    }
    return true;
  }

  const int pipe_;
  const ChildLimits& limits_;
  const StopToken& stop_;
  const Clock::time_point deadline_;
};

// Describes an exit status in words that follow "the child".
std::string how_it_ended(int status) {
  if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    if (signal == SIGXCPU) return "took more processor time than it may";
    return fmt::format("ended by signal {} ({})", signal, ::strsignal(signal));
  }
  return fmt::format("ended with status {} before its answer was whole", WEXITSTATUS(status));
}

}  // namespace

// An answer is its size in eight bytes, then its content: write_to_parent() writes it, Answer reads it.
std::string run_child(const std::string& program, const std::vector<std::string>& arguments, int input,
                      const ChildLimits& limits, const StopToken& stop) {
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) throw ChildFailed(fmt::format("cannot be started ({})", error_text(errno)));
  const Descriptor from(ends[0]);
  Descriptor to(ends[1]);
  Child child(program, arguments, input, to.get());
  to.close();  // otherwise the pipe would never end
  const Answer answer(from.get(), limits, stop);
  if (auto bytes = answer.read_all()) return std::move(*bytes);
  // The answer is too short: wait for the exit status, which tells why.
  for (;;) {
    if (const auto status = child.ended()) throw ChildFailed(how_it_ended(*status));
    answer.check();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

bool write_to_parent(const std::string& answer) {
  const std::uint64_t size = answer.size();
  return dem::write_all(STDOUT_FILENO, {reinterpret_cast<const char*>(&size), sizeof size}) == 0 &&
         dem::write_all(STDOUT_FILENO, answer) == 0;
}

}  // namespace selenograph::engine
