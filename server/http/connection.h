// One client's TCP connection, as cpp-httplib reads and writes it: every wait ends at a deadline.
#pragma once

#include <fcntl.h>
#include <httplib.h>
#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <string>
#include <string_view>

namespace selenograph::server {

class Connection : public httplib::Stream {
 public:
  using Clock = std::chrono::steady_clock;

  // Takes ownership of the socket.
  explicit Connection(int fd)
      : remote_address(address_of(fd, ::getpeername)), local_address(address_of(fd, ::getsockname)), fd_(fd) {
    ::fcntl(fd_, F_SETFD, FD_CLOEXEC);
  }
  ~Connection() override { ::close(fd_); }

  const std::string remote_address, local_address;  // numeric, without port; empty: unknown

  // All reads and writes from now on must end within `time`, and reads return at most `bytes`.
  void limit_time(std::chrono::milliseconds time) { deadline_ = Clock::now() + time; }
  void limit_bytes(std::size_t bytes) { readable_bytes_ = bytes; }
  bool is_late() const { return Clock::now() >= deadline_; }
  bool is_at_limit() const { return readable_bytes_ == 0; }

  // Waits for the first byte of a request. Returns false at the deadline and at the end of the stream.
  bool wait_for_request() { return !unread_.empty() || fill(); }

  // Shuts down sending, and discards received bytes for a limited time: closing at once would send a reset to a client
  // that is still sending a rejected body, and the reset would discard the answer.
  void linger() {
    ::shutdown(fd_, SHUT_WR);
    limit_time(std::chrono::seconds(2));
    while (fill()) continue;
  }

  // True after cut(), and once detect_disconnect() has found that the client has closed its connection or its half.
  const std::atomic<bool>& abandoned() const { return abandoned_; }

  // The following may be called from any thread.
  void detect_disconnect() {
    pollfd event{fd_, POLLRDHUP, 0};
    if (::poll(&event, 1, 0) > 0) abandoned_ = true;
  }
  // Ends the stream behind the bytes that have arrived.
  void end_reading() { ::shutdown(fd_, SHUT_RD); }
  // Makes all reads and writes fail.
  void cut() {
    abandoned_ = true;
    ::shutdown(fd_, SHUT_RDWR);
  }

  // Interface of the library, which writes the rest of what write() leaves. Both return -1 at the deadline.
  ssize_t read(char* to, std::size_t size) override {
    if (is_at_limit() || (unread_.empty() && !fill())) return -1;
    const std::size_t count = unread_.copy(to, std::min(size, readable_bytes_));
    unread_.remove_prefix(count);
    readable_bytes_ -= count;
    return static_cast<ssize_t>(count);
  }
  ssize_t write(const char* bytes, std::size_t size) override {
    return wait_for(POLLOUT) ? ::send(fd_, bytes, size, MSG_NOSIGNAL | MSG_DONTWAIT) : -1;
  }
  bool is_readable() const override { return true; }
  bool is_writable() const override { return true; }
  socket_t socket() const override { return 0; }  // the library only compares it with FD_SETSIZE
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}

 private:
  // Returns the numeric address of an end of a connection, which `get_end` reads; empty if it has none.
  static std::string address_of(int fd, decltype(::getpeername)* get_end) {
    sockaddr_storage storage{};
    socklen_t size = sizeof storage;
    auto* const end = reinterpret_cast<sockaddr*>(&storage);
    std::array<char, NI_MAXHOST> text{};
    if (get_end(fd, end, &size) != 0) return {};
    if (::getnameinfo(end, size, text.data(), text.size(), nullptr, 0, NI_NUMERICHOST) != 0) return {};
    const std::string_view address = text.data();
    return std::string(address.substr(address.starts_with("::ffff:") ? 7 : 0));  // an IPv4 address at an IPv6 socket
  }

  // Waits until `event` (POLLIN or POLLOUT) is possible. Returns false at the deadline.
  bool wait_for(short event) const {
    const auto left_ms = std::chrono::ceil<std::chrono::milliseconds>(deadline_ - Clock::now()).count();
    pollfd socket{fd_, event, 0};
    return left_ms > 0 && ::poll(&socket, 1, static_cast<int>(std::min<long>(left_ms, 1 << 30))) > 0;
  }

  // Waits for at least one byte. Returns false if none arrives until the deadline, or the client has disconnected.
  bool fill() {
    const ssize_t count = wait_for(POLLIN) ? ::recv(fd_, input_.data(), input_.size(), MSG_DONTWAIT) : -1;
    unread_ = {input_.data(), static_cast<std::size_t>(std::max<ssize_t>(count, 0))};
    return count > 0;
  }

  const int fd_;
  std::array<char, 16384> input_;
  std::string_view unread_;  // received bytes in input_
  Clock::time_point deadline_{};
  std::size_t readable_bytes_ = 0;
  std::atomic<bool> abandoned_{false};
};

}  // namespace selenograph::server
