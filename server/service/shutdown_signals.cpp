#include "server/service/shutdown_signals.h"

#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <system_error>

namespace selenograph::server {
namespace {

constexpr char kNoSignal = 0;

std::atomic<int> pipe_of_handler{-1};
static_assert(std::atomic<int>::is_always_lock_free);  // the signal handler reads it

// Handler: passes the signal to the thread of ShutdownSignals. Only async-signal-safe functions are allowed here, and
// errno belongs to the interrupted code.
void write_to_pipe(int signal) {
  const int error = errno;
  const char byte = static_cast<char>(signal);
  [[maybe_unused]] const ssize_t written = ::write(pipe_of_handler, &byte, 1);
  errno = error;
}

constexpr std::array kHandled{SIGTERM, SIGINT, SIGHUP};

// An ignored hangup (nohup) stays ignored.
bool is_ignored_hangup(int signal) {
  struct sigaction current {};
  return signal == SIGHUP && ::sigaction(signal, nullptr, &current) == 0 && current.sa_handler == SIG_IGN;
}

void set_handler(void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;
  for (const int signal : kHandled)
    if (!is_ignored_hangup(signal)) ::sigaction(signal, &action, nullptr);
}

// Blocks (SIG_BLOCK) or unblocks the signals for the calling thread.
void mask(int how) {
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : kHandled) sigaddset(&set, signal);
  ::pthread_sigmask(how, &set, nullptr);
}

}  // namespace

// Installs a handler in addition to the mask: threads that a library started before main() (OpenBLAS does) do not block
// the signals, and sigwait() in this object's thread would miss what they receive.
ShutdownSignals::ShutdownSignals() {
  if (::pipe2(pipe_.data(), O_CLOEXEC | O_NONBLOCK) != 0)
    throw std::system_error(errno, std::generic_category(), "cannot create a pipe for signals");
  pipe_of_handler = pipe_[1];
  set_handler(write_to_pipe);
  mask(SIG_BLOCK);
  thread_ = std::thread([this] {
    mask(SIG_UNBLOCK);
    run();
  });
}

// Ignores signals from here on: the work is finished.
ShutdownSignals::~ShutdownSignals() {
  set_handler(SIG_IGN);
  [[maybe_unused]] const ssize_t written = ::write(pipe_[1], &kNoSignal, 1);
  thread_.join();
  ::close(pipe_[0]);
  ::close(pipe_[1]);
}

// Waits for signals from the pipe, and ends the process at the time limit or on the second signal.
void ShutdownSignals::run() {
  using Clock = std::chrono::steady_clock;
  auto deadline = Clock::time_point::max();  // set by the first signal
  const auto poll_timeout_ms = [&] {
    if (deadline == Clock::time_point::max()) return -1;  // no limit
    return std::max(0, static_cast<int>(std::chrono::ceil<std::chrono::milliseconds>(deadline - Clock::now()).count()));
  };
  for (;;) {
    pollfd waiting{pipe_[0], POLLIN, 0};
    const int ready = ::poll(&waiting, 1, poll_timeout_ms());
    if (ready == 0) ::_exit(1);  // the time limit has passed
    char signal = kNoSignal;
    if (ready < 0 || ::read(pipe_[0], &signal, 1) != 1) continue;
    if (signal == kNoSignal) return;
    const bool is_first = deadline == Clock::time_point::max();
    if (signal == SIGHUP && !is_first) continue;      // a closing terminal sends several
    if (!armed_ || !is_first) ::_exit(128 + signal);  // a shell's status of a process that a signal ended
    deadline = Clock::now() + time_limit_.load();
    first_.set_value();
  }
}

}  // namespace selenograph::server
