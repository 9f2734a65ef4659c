#include "server/http/connection.h"

#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <limits>
#include <utility>

namespace selenograph::server {
namespace {

constexpr std::size_t kGather = 65536;

// poll(), not select(): a file descriptor above 1023 is an ordinary one.
bool wait_for(int fd, short events, Connection::Clock::time_point deadline) {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Connection::Clock::now()).count();
    if (left <= 0) return false;
    pollfd p{fd, events, 0};
    const int ready = ::poll(&p, 1, static_cast<int>(std::min<long>(left, std::numeric_limits<int>::max())));
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
  }
}

}  // namespace

Connection::Connection(int fd, Peer peer, const SendPace& pace) : fd_(fd), peer_(std::move(peer)), pace_(pace) {}
Connection::~Connection() { ::close(fd_); }

// What is consumed goes when it is half of the whole: each byte is moved once, and never is more kept than came ahead.
void Connection::consume(std::size_t bytes) {
  consumed_ += bytes;
  if (2 * consumed_ < input_.size()) return;
  input_.erase(0, consumed_);
  consumed_ = 0;
}

Connection::Read Connection::fill(Clock::time_point deadline) {
  std::array<char, 65536> chunk;
  for (;;) {
    const ssize_t n = ::recv(fd_, chunk.data(), chunk.size(), MSG_DONTWAIT);
    if (n > 0) {
      heard_ = Clock::now();
      input_.append(chunk.data(), static_cast<std::size_t>(n));
      return Read::data;
    }
    if (n == 0) return Read::closed;
    if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) return Read::closed;
    if (!wait_for(fd_, POLLIN, deadline)) return Read::timed_out;
  }
}

bool Connection::write(std::string_view bytes) {
  if (output_.size() + bytes.size() <= kGather) {
    output_.append(bytes);
    return true;
  }
  const std::string head = std::exchange(output_, {});
  return send_all(head, bytes);
}

bool Connection::flush() {
  const bool sent = output_.empty() || send_all(output_, {});
  output_.clear();
  if (sent) sent_bytes_ = 0;
  return sent;
}

bool Connection::write_without_memory(std::string_view answer) {
  output_.clear();
  return send_all(answer, {});
}

bool Connection::send_all(std::string_view head, std::string_view body) {
  if (sent_bytes_ == 0) answer_start_ = Clock::now();
  // Moves on with what the client takes: one that takes nothing is gone after the grace, however long the answer.
  const auto deadline = [&] {
    const std::chrono::duration<double> allowed(static_cast<double>(sent_bytes_.load()) / pace_.bytes_per_s);
    return answer_start_ + pace_.grace + std::chrono::duration_cast<Clock::duration>(allowed);
  };
  while (!head.empty() || !body.empty()) {
    std::array<iovec, 2> parts{iovec{const_cast<char*>(head.data()), head.size()},
                               iovec{const_cast<char*>(body.data()), body.size()}};
    msghdr message{};
    message.msg_iov = parts.data();
    message.msg_iovlen = parts.size();
    const ssize_t n = ::sendmsg(fd_, &message, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n < 0) {
      if (errno == EINTR) continue;
      if ((errno != EAGAIN && errno != EWOULDBLOCK) || !wait_for(fd_, POLLOUT, deadline())) return false;
      continue;
    }
    sent_bytes_ += static_cast<std::size_t>(n);
    const std::size_t of_head = std::min(head.size(), static_cast<std::size_t>(n));
    head.remove_prefix(of_head);
    body.remove_prefix(static_cast<std::size_t>(n) - of_head);
  }
  return true;
}

void Connection::linger(std::chrono::milliseconds at_most) {
  ::shutdown(fd_, SHUT_WR);
  const auto deadline = Clock::now() + at_most;
  do {
    consume(unread().size());
  } while (Clock::now() < deadline && fill(deadline) == Read::data);
}

bool Connection::move_on(State from, State to) { return state_.compare_exchange_strong(from, to); }

bool Connection::begin_work() { return move_on(State::waiting, State::working); }

void Connection::begin_answer() {
  since_ = Clock::now();
  move_on(State::working, State::answering);
}

void Connection::end_work() {
  since_ = Clock::now();
  if (!move_on(State::working, State::waiting)) move_on(State::answering, State::waiting);
}

bool Connection::silent(Clock::time_point now) const {
  constexpr auto kMoment = std::chrono::milliseconds(250);
  int unread_bytes = 0;
  if (::ioctl(fd_, FIONREAD, &unread_bytes) == 0 && unread_bytes > 0) return false;
  const auto heard = heard_.load();
  return heard < since_.load() || now - heard >= kMoment;
}

bool Connection::give_up() {
  if (!move_on(State::waiting, State::given_up)) return false;
  cut();
  return true;
}

bool Connection::give_up_if_slow(Clock::time_point now) {
  const std::chrono::duration<double> reading = now - since_.load();
  if (reading < kSlowAfter || static_cast<double>(sent_bytes_.load()) >= reading.count() * kSlow_bytes_per_s)
    return false;
  if (!move_on(State::answering, State::given_up)) return false;
  cut();
  return true;
}

void Connection::cut() { ::shutdown(fd_, SHUT_RDWR); }

}  // namespace selenograph::server
