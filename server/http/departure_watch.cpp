#include "server/http/departure_watch.h"

#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <string_view>

namespace selenograph::server {
namespace {

constexpr std::string_view kInterim = "HTTP/1.1 100 Continue\r\n\r\n";
constexpr int kAskEvery_ms = 3000;

}  // namespace

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

// Allocates nothing: this thread must outlive a lack of memory.
void DepartureWatch::run() {
  std::array<epoll_event, 32> events;
  for (;;) {
    const int n = ::epoll_wait(epoll_, events.data(), static_cast<int>(events.size()), kAskEvery_ms);
    for (int i = 0; i < n; ++i) {
      const epoll_event& event = events[static_cast<std::size_t>(i)];
      if (event.data.u64 == 0) return;
      note(event.data.u64, event.events);
    }
    if (n == 0) ask_again();
  }
}

void DepartureWatch::note(std::uint64_t id, std::uint32_t events) {
  const std::lock_guard lock(mutex_);
  const auto found = watched_.find(id);
  if (found == watched_.end()) return;
  Watched& client = found->second;
  if (events & (EPOLLHUP | EPOLLERR)) {
    *client.left = true;
    return;
  }
  // From now on for what is always reported, and no more for the FIN that stays.
  client.half_closed = true;
  epoll_event rest{EPOLLONESHOT, {.u64 = id}};
  ::epoll_ctl(epoll_, EPOLL_CTL_MOD, client.fd, &rest);
  ask(client);
}

void DepartureWatch::ask_again() {
  const std::lock_guard lock(mutex_);
  for (auto& [id, client] : watched_) {
    if (client.half_closed) ask(client);
  }
}

// A part of an interim answer can't be taken back: then the connection is of no more use.
void DepartureWatch::ask(Watched& client) {
  if (!client.interim_answers) return;
  const ssize_t sent = ::send(client.fd, kInterim.data(), kInterim.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
  if (sent <= 0 || sent == static_cast<ssize_t>(kInterim.size())) return;
  ::shutdown(client.fd, SHUT_RDWR);
  *client.left = true;
}

DepartureWatch::Guard::Guard(DepartureWatch& watch, int fd, bool interim_answers, std::atomic<bool>* left)
    : watch_(watch), fd_(fd) {
  {
    const std::lock_guard lock(watch_.mutex_);
    id_ = watch_.next_id_++;
    watch_.watched_.emplace(id_, Watched{fd, interim_answers, left});
  }
  epoll_event event{EPOLLRDHUP | EPOLLONESHOT, {.u64 = id_}};
  ::epoll_ctl(watch_.epoll_, EPOLL_CTL_ADD, fd_, &event);
}

// Under the same lock as run(): afterwards nobody touches `left` or writes to the socket, even if an event is on its
// way.
DepartureWatch::Guard::~Guard() {
  ::epoll_ctl(watch_.epoll_, EPOLL_CTL_DEL, fd_, nullptr);
  const std::lock_guard lock(watch_.mutex_);
  watch_.watched_.erase(id_);
}

}  // namespace selenograph::server
