#include "server/departure_watch.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <array>

namespace selenograph::server {

DepartureWatch::DepartureWatch() : epoll_(::epoll_create1(EPOLL_CLOEXEC)), wake_(::eventfd(0, EFD_CLOEXEC)) {
  epoll_event event{EPOLLIN, {.u64 = 0}};
  ::epoll_ctl(epoll_, EPOLL_CTL_ADD, wake_, &event);
  thread_ = std::thread([this] { run(); });
}

DepartureWatch::~DepartureWatch() {
  const std::uint64_t one = 1;
  [[maybe_unused]] const ssize_t written = ::write(wake_, &one, sizeof(one));
  thread_.join();
  ::close(wake_);
  ::close(epoll_);
}

void DepartureWatch::run() {
  std::array<epoll_event, 32> events;
  for (;;) {
    const int n = ::epoll_wait(epoll_, events.data(), static_cast<int>(events.size()), -1);
    for (int i = 0; i < n; ++i) {
      const std::uint64_t id = events[static_cast<std::size_t>(i)].data.u64;
      if (id == 0) return;
      const std::lock_guard lock(mutex_);
      if (const auto found = watched_.find(id); found != watched_.end()) *found->second = true;
    }
  }
}

DepartureWatch::Guard::Guard(DepartureWatch& watch, int fd, std::atomic<bool>* left) : watch_(watch), fd_(fd) {
  {
    const std::lock_guard lock(watch_.mutex_);
    id_ = watch_.next_id_++;
    watch_.watched_[id_] = left;
  }
  epoll_event event{EPOLLRDHUP | EPOLLONESHOT, {.u64 = id_}};
  ::epoll_ctl(watch_.epoll_, EPOLL_CTL_ADD, fd_, &event);
}

// Under the same lock as run(): afterwards nobody touches `left`, even if an event is on its way.
DepartureWatch::Guard::~Guard() {
  ::epoll_ctl(watch_.epoll_, EPOLL_CTL_DEL, fd_, nullptr);
  const std::lock_guard lock(watch_.mutex_);
  watch_.watched_.erase(id_);
}

}  // namespace selenograph::server
