#include "server/http/connection.h"

#include <fcntl.h>
#include <netdb.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <limits>

namespace selenograph::server {
namespace {

constexpr auto kLinger = std::chrono::milliseconds(2000);

// Returns the numeric address of an end of a connection, which `get_end` reads; empty if it has none.
std::string address_of(int fd, decltype(::getpeername)* get_end) {
  sockaddr_storage storage{};
  socklen_t size = sizeof storage;
  auto* const end = reinterpret_cast<sockaddr*>(&storage);
  std::array<char, NI_MAXHOST> text{};
  if (get_end(fd, end, &size) != 0) return {};
  if (::getnameinfo(end, size, text.data(), text.size(), nullptr, 0, NI_NUMERICHOST) != 0) return {};
  const std::string_view address = text.data();
  constexpr std::string_view kMapped = "::ffff:";  // prefix of an IPv4 address at an IPv6 socket
  const bool is_mapped = address.starts_with(kMapped) && address.find('.') != std::string_view::npos;
  return std::string(is_mapped ? address.substr(kMapped.size()) : address);
}

}  // namespace

Connection::Connection(int fd)
    : fd_(fd), remote_address_(address_of(fd, ::getpeername)), local_address_(address_of(fd, ::getsockname)) {
  const int on = 1;
  ::fcntl(fd_, F_SETFD, FD_CLOEXEC);
  ::setsockopt(fd_, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

Connection::~Connection() { ::close(fd_); }

// Waits until `events` (POLLIN or POLLOUT) are possible. Returns false at the deadline, or if waiting fails. It uses
// poll(), because select() cannot wait for a file descriptor above 1023.
bool Connection::wait_for(short events) const {
  for (;;) {
    const auto left_ms = std::chrono::ceil<std::chrono::milliseconds>(deadline_ - Clock::now()).count();
    if (left_ms <= 0) return false;
    pollfd socket{fd_, events, 0};
    const int ready = ::poll(&socket, 1, static_cast<int>(std::min<long>(left_ms, std::numeric_limits<int>::max())));
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
  }
}

// Waits for at least one byte. Returns false if none arrives until the deadline, or the client has disconnected.
bool Connection::fill() {
  for (;;) {
    const ssize_t count = ::recv(fd_, input_.data(), input_.size(), MSG_DONTWAIT);
    if (count > 0) {
      unread_ = {input_.data(), static_cast<std::size_t>(count)};
      return true;
    }
    if (count == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) return false;
    if (!wait_for(POLLIN)) return false;
  }
}

bool Connection::wait_for_request(Clock::time_point deadline) {
  deadline_ = deadline;
  sent_bytes_ = 0;
  is_idle_ = true;
  const bool has_bytes = !unread_.empty() || fill();
  is_idle_ = false;
  return has_bytes;
}

ssize_t Connection::read(char* to, std::size_t size) {
  if (readable_bytes_ == 0 || (unread_.empty() && !fill())) return -1;
  const std::size_t count = unread_.copy(to, std::min(size, readable_bytes_));
  unread_.remove_prefix(count);
  readable_bytes_ -= count;
  return static_cast<ssize_t>(count);
}

// Sends all bytes: the library would send the rest of a partial write by itself, but not of a head.
ssize_t Connection::write(const char* bytes, std::size_t size) {
  for (std::size_t done = 0; done < size;) {
    const ssize_t count = ::send(fd_, bytes + done, size - done, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (count < 0) {
      if (errno == EINTR) continue;
      if ((errno != EAGAIN && errno != EWOULDBLOCK) || !wait_for(POLLOUT)) return -1;
      continue;
    }
    done += static_cast<std::size_t>(count);
    sent_bytes_ += static_cast<std::size_t>(count);
  }
  return static_cast<ssize_t>(size);
}

void Connection::linger() {
  ::shutdown(fd_, SHUT_WR);
  limit_time(kLinger);
  while (!is_late() && fill()) {
  }
}

void Connection::begin_work() {
  abandoned_ = false;
  is_in_work_ = true;
}

void Connection::detect_disconnect() {
  pollfd event{fd_, POLLRDHUP, 0};
  if (is_in_work_ && ::poll(&event, 1, 0) > 0) abandoned_ = true;
}

bool Connection::end_idle() { return is_idle_ && ::shutdown(fd_, SHUT_RD) == 0; }

void Connection::cut() { ::shutdown(fd_, SHUT_RDWR); }

}  // namespace selenograph::server
