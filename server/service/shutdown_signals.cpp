#include "server/service/shutdown_signals.h"

#include <poll.h>
#include <pthread.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <csignal>
#include <cstdint>

namespace selenograph::server {

ShutdownSignals::ShutdownSignals() : wake_(::eventfd(0, EFD_CLOEXEC)) {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGINT);
  ::pthread_sigmask(SIG_BLOCK, &set, nullptr);
  signals_ = ::signalfd(-1, &set, SFD_CLOEXEC);
  thread_ = std::thread([this] { run(); });
}

ShutdownSignals::~ShutdownSignals() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(wake_, &one, sizeof(one));
  thread_.join();
  ::close(signals_);
  ::close(wake_);
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
    std::array<pollfd, 2> waiting{pollfd{signals_, POLLIN, 0}, pollfd{wake_, POLLIN, 0}};
    const int ready = ::poll(waiting.data(), waiting.size(), left_ms());
    if (ready == 0) ::_exit(1);
    if (ready < 0) continue;
    if (waiting[1].revents) return;
    signalfd_siginfo info{};
    if (::read(signals_, &info, sizeof(info)) != sizeof(info)) continue;
    const bool first = last_moment == Clock::time_point::max();
    if (!armed_ || !first) ::_exit(128 + static_cast<int>(info.ssi_signo));
    last_moment = Clock::now() + at_most_.load();
    first_.set_value();
  }
}

}  // namespace selenograph::server
