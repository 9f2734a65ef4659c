#include "server/connection.h"

#include <poll.h>
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
constexpr double kSlowestReader_bytes_per_s = 65536;
constexpr auto kReaderGrace = std::chrono::seconds(10);

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

Connection::Connection(int fd) : fd_(fd) {}
Connection::~Connection() { ::close(fd_); }

void Connection::consume(std::size_t bytes) {
  consumed_ += bytes;
  if (consumed_ < input_.size()) return;
  input_.clear();
  consumed_ = 0;
}

Connection::Read Connection::fill(Clock::time_point deadline) {
  std::array<char, 65536> chunk;
  for (;;) {
    const ssize_t n = ::recv(fd_, chunk.data(), chunk.size(), MSG_DONTWAIT);
    if (n > 0) {
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

bool Connection::flush() { return output_.empty() || send_all(std::exchange(output_, {}), {}); }

bool Connection::send_all(std::string_view head, std::string_view body) {
  const auto start = Clock::now();
  double sent_bytes = 0;
  // Moves on with what the client takes: one that takes nothing is gone after the grace, however long the answer.
  const auto deadline = [&] {
    const std::chrono::duration<double> allowed(sent_bytes / kSlowestReader_bytes_per_s);
    return start + kReaderGrace + std::chrono::duration_cast<Clock::duration>(allowed);
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
    sent_bytes += static_cast<double>(n);
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

bool Connection::begin_work() {
  State expected = State::waiting;
  return state_.compare_exchange_strong(expected, State::working);
}

void Connection::end_work() {
  waiting_since_ = Clock::now();
  State expected = State::working;
  state_.compare_exchange_strong(expected, State::waiting);
}

bool Connection::give_up() {
  State expected = State::waiting;
  if (!state_.compare_exchange_strong(expected, State::given_up)) return false;
  ::shutdown(fd_, SHUT_RDWR);
  return true;
}

}  // namespace selenograph::server
