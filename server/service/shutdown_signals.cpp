#include "server/service/shutdown_signals.h"

#include <semaphore.h>
#include <sys/time.h>
#include <unistd.h>

#include <atomic>
#include <csignal>

namespace selenograph::server {
namespace {

sem_t first_signal;
std::atomic<bool> is_armed{false}, has_begun{false};
static_assert(std::atomic<bool>::is_always_lock_free);  // the signal handler uses them

// Linux gives a signal to the main thread if it can, and interrupts no other. Only async-signal-safe functions are
// allowed here.
void handle(int signal) {
  if (signal == SIGALRM) ::_exit(1);  // the time limit
  const bool is_first = !has_begun.exchange(true);
  if (signal == SIGHUP && !is_first) return;          // a closing terminal sends several
  if (!is_armed || !is_first) ::_exit(128 + signal);  // a shell's status of a process that a signal ended
  ::sem_post(&first_signal);
}

void set_handler(void (*handler)(int)) {
  struct sigaction action {};
  action.sa_handler = handler;
  action.sa_flags = SA_RESTART;
  for (const int signal : {SIGTERM, SIGINT, SIGHUP, SIGALRM}) {
    struct sigaction current {};
    ::sigaction(signal, nullptr, &current);
    if (signal == SIGHUP && current.sa_handler == SIG_IGN) continue;  // an ignored hangup (nohup) stays ignored
    ::sigaction(signal, &action, nullptr);
  }
}

}  // namespace

ShutdownSignals::ShutdownSignals() {
  ::sem_init(&first_signal, 0, 0);
  set_handler(handle);
}

// Ignores signals from here on: the work is finished.
ShutdownSignals::~ShutdownSignals() { set_handler(SIG_IGN); }

void ShutdownSignals::arm(std::chrono::milliseconds time_limit) {
  time_limit_ = time_limit;
  is_armed = true;
}

void ShutdownSignals::wait() const {
  while (::sem_wait(&first_signal) != 0) continue;
  const auto seconds = std::chrono::floor<std::chrono::seconds>(time_limit_);
  const auto rest = std::chrono::microseconds(time_limit_ - seconds);
  const itimerval timer{.it_interval = {}, .it_value = {seconds.count(), rest.count()}};
  ::setitimer(ITIMER_REAL, &timer, nullptr);
}

}  // namespace selenograph::server
