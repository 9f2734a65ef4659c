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
static_assert(std::atomic<int>::is_always_lock_free);  // it is read by a signal's handler

void pass_on(int signal) {
  const int error = errno;
  const char byte = static_cast<char>(signal);
  [[maybe_unused]] const ssize_t written = ::write(pipe_of_handler, &byte, 1);
  errno = error;
}

constexpr std::array kHandled{SIGTERM, SIGINT, SIGHUP};

// A hangup that is ignored (nohup) stays so.
bool is_ignored_hangup(int signal) {
  struct sigaction now {};
  return signal == SIGHUP && ::sigaction(signal, nullptr, &now) == 0 && now.sa_handler == SIG_IGN;
}

void set_handler(void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;
  for (const int signal : kHandled)
    if (!is_ignored_hangup(signal)) ::sigaction(signal, &action, nullptr);
}

void mask(int how) {
  sigset_t set;
  sigemptyset(&set);
  for (const int signal : kHandled) sigaddset(&set, signal);
  ::pthread_sigmask(how, &set, nullptr);
}

}  // namespace

// A handler beside the mask: a library's thread from before main() (OpenBLAS has some) doesn't block the signals.
ShutdownSignals::ShutdownSignals() {
  if (::pipe2(pipe_.data(), O_CLOEXEC | O_NONBLOCK) != 0)
    throw std::system_error(errno, std::generic_category(), "a pipe for signals");
  pipe_of_handler = pipe_[1];
  set_handler(pass_on);
  mask(SIG_BLOCK);
  thread_ = std::thread([this] {
    mask(SIG_UNBLOCK);
    run();
  });
}

// All is done: from here on a signal changes nothing.
ShutdownSignals::~ShutdownSignals() {
  set_handler(SIG_IGN);
  [[maybe_unused]] const ssize_t written = ::write(pipe_[1], &kNoSignal, 1);
  thread_.join();
  ::close(pipe_[0]);
  ::close(pipe_[1]);
}

void ShutdownSignals::run() {
  using Clock = std::chrono::steady_clock;
  auto last_moment = Clock::time_point::max();
  const auto left_ms = [&] {
    if (last_moment == Clock::time_point::max()) return -1;  // forever
    return std::max(0,
                    static_cast<int>(std::chrono::ceil<std::chrono::milliseconds>(last_moment - Clock::now()).count()));
  };
  for (;;) {
    pollfd waiting{pipe_[0], POLLIN, 0};
    const int ready = ::poll(&waiting, 1, left_ms());
    if (ready == 0) ::_exit(1);
    char signal = kNoSignal;
    if (ready < 0 || ::read(pipe_[0], &signal, 1) != 1) continue;
    if (signal == kNoSignal) return;
    const bool first = last_moment == Clock::time_point::max();
    if (signal == SIGHUP && !first) continue;  // a terminal that closes sends several
    if (!armed_ || !first) ::_exit(128 + signal);
    last_moment = Clock::now() + at_most_.load();
    first_.set_value();
  }
}

}  // namespace selenograph::server
