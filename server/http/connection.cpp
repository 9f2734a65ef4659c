#include "server/http/connection.h"

#include <fmt/format.h>
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

constexpr std::size_t kMaxGatheredBytes = 65536;  // output that waits for a larger write or for flush()

// Waits until `events` (POLLIN or POLLOUT) are possible. Returns false at the deadline, or if waiting fails. It uses
// poll(), because select() cannot wait for a file descriptor above 1023.
bool wait_for(int fd, short events, Connection::Clock::time_point deadline) {
  for (;;) {
    const auto left = std::chrono::ceil<std::chrono::milliseconds>(deadline - Connection::Clock::now()).count();
    if (left <= 0) return false;
    pollfd socket{fd, events, 0};
    const int ready = ::poll(&socket, 1, static_cast<int>(std::min<long>(left, std::numeric_limits<int>::max())));
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
  }
}

}  // namespace

Connection::Connection(int fd, Peer peer, const SendPace& pace) : fd_(fd), peer_(std::move(peer)), pace_(pace) {}
Connection::~Connection() { ::close(fd_); }

bool Connection::begin_request(std::chrono::milliseconds idle, std::chrono::milliseconds receive) {
  const auto idle_deadline = Clock::now() + idle;
  for (;;) {
    // Skip empty lines before a request (RFC 9112 2.2).
    while (!unread_.empty() && (unread_.front() == '\r' || unread_.front() == '\n')) unread_.remove_prefix(1);
    if (!unread_.empty()) break;
    if (!fill(idle_deadline)) return false;
  }
  receive_deadline_ = Clock::now() + receive;
  head_bytes_ = 0;
  line_bytes_ = 0;
  head_lines_ = 0;
  in_head_ = true;
  problem_.reset();
  return true;
}

ssize_t Connection::read(char* to, std::size_t size) {
  // Send what is gathered before waiting: the client may wait for it, as for "100 Continue".
  if (problem_ || (unread_.empty() && !(flush() && fill(receive_deadline_)))) {
    if (is_late_ && !problem_) problem_ = Refusal{"request_timeout", "the request did not arrive in time"};
    return -1;
  }
  const std::size_t bytes = unread_.copy(to, size);
  unread_.remove_prefix(bytes);
  // The library reads lines byte by byte, and bodies in larger blocks.
  if (size == 1 && !check_line_limits(*to)) return -1;
  return static_cast<ssize_t>(bytes);
}

// Counts a byte of a line, whose length the library does not bound. Returns false if the line or the head is too long,
// or the head has too many fields.
bool Connection::check_line_limits(char byte) {
  const bool in_first_line = in_head_ && head_bytes_ == line_bytes_;  // no line has ended
  ++line_bytes_;
  ++head_bytes_;
  if (line_bytes_ > kMaxLineBytes && in_first_line)
    problem_ = Refusal{"uri_too_long", "the request target is too long"};
  else if (line_bytes_ > kMaxLineBytes && !in_head_)
    problem_ = Refusal{"malformed_request", "a line of the body's chunked encoding is too long"};
  else if (line_bytes_ > kMaxLineBytes)
    problem_ = Refusal{"headers_too_large", fmt::format("a header line has more than {} bytes", kMaxLineBytes)};
  else if (in_head_ && head_bytes_ > kMaxHeadBytes)
    problem_ = Refusal{"headers_too_large", fmt::format("the head has more than {} bytes", kMaxHeadBytes)};
  if (byte != '\n') return !problem_;
  constexpr std::size_t kEmptyLineBytes = 2, kRequestLines = 1;
  if (in_head_ && line_bytes_ > kEmptyLineBytes) ++head_lines_;
  if (head_lines_ > kRequestLines + kMaxHeadFields)
    problem_ = Refusal{"headers_too_large", fmt::format("the head has more than {} fields", kMaxHeadFields)};
  line_bytes_ = 0;
  return !problem_;
}

// Waits for at least one byte. Returns false if none arrives until the deadline, or the client closes its connection.
bool Connection::fill(Clock::time_point deadline) {
  is_late_ = false;
  for (;;) {
    const ssize_t n = ::recv(fd_, input_.data(), input_.size(), MSG_DONTWAIT);
    if (n > 0) {
      unread_ = {input_.data(), static_cast<std::size_t>(n)};
      return true;
    }
    if (n == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) return false;
    if (!wait_for(fd_, POLLIN, deadline)) {
      is_late_ = true;
      return false;
    }
  }
}

bool Connection::write(std::string_view bytes) {
  // Gather small writes. A large one is sent at once, behind what has been gathered, and is never copied.
  if (output_.size() + bytes.size() <= kMaxGatheredBytes) {
    output_.append(bytes);
    return true;
  }
  const std::string gathered = std::exchange(output_, {});
  return send_all(gathered, bytes);
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

// Sends both texts as if joined. Returns false if the client is too slow or has disconnected.
bool Connection::send_all(std::string_view gathered, std::string_view rest) {
  if (sent_bytes_ == 0) answer_start_ = Clock::now();
  // Each byte that the client takes extends its deadline; a client that takes none is cut after the grace.
  const auto deadline = [&] {
    const std::chrono::duration<double> allowed(static_cast<double>(sent_bytes_) / pace_.bytes_per_s);
    return answer_start_ + pace_.grace + std::chrono::duration_cast<Clock::duration>(allowed);
  };
  while (!gathered.empty() || !rest.empty()) {
    std::array<iovec, 2> parts{iovec{const_cast<char*>(gathered.data()), gathered.size()},
                               iovec{const_cast<char*>(rest.data()), rest.size()}};
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
    const std::size_t gathered_bytes = std::min(gathered.size(), static_cast<std::size_t>(n));
    gathered.remove_prefix(gathered_bytes);
    rest.remove_prefix(static_cast<std::size_t>(n) - gathered_bytes);
  }
  return true;
}

void Connection::linger(std::chrono::milliseconds time_limit) {
  ::shutdown(fd_, SHUT_WR);
  // Read and discard: fill() overwrites the unread bytes, and fails when the client closes its side.
  const auto deadline = Clock::now() + time_limit;
  while (Clock::now() < deadline && fill(deadline)) {
  }
}

// Returns false, and changes nothing, if the state is not `from`.
bool Connection::change_state(State from, State to) { return state_.compare_exchange_strong(from, to); }

bool Connection::begin_work() {
  abandoned_ = false;
  return change_state(State::waiting, State::working);
}

void Connection::end_work() {
  since_ = Clock::now();
  change_state(State::working, State::waiting);
}

bool Connection::give_up() {
  if (!change_state(State::waiting, State::given_up)) return false;
  cut();
  return true;
}

void Connection::detect_disconnect() {
  pollfd event{fd_, POLLRDHUP, 0};
  if (state_ == State::working && ::poll(&event, 1, 0) > 0) abandoned_ = true;
}

void Connection::cut() { ::shutdown(fd_, SHUT_RDWR); }

}  // namespace selenograph::server
