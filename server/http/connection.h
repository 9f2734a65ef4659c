// One client's TCP connection, as cpp-httplib reads and writes it: every wait ends at a deadline.
#pragma once

// Debian's cpp-httplib is a compiled library, and macros determine the layout of its classes. `pkg-config --cflags
// cpp-httplib` gives the macros that it was built with.
#if !defined(CPPHTTPLIB_OPENSSL_SUPPORT) || !defined(CPPHTTPLIB_ZLIB_SUPPORT) || !defined(CPPHTTPLIB_BROTLI_SUPPORT)
#error "compile with the flags of pkg-config --cflags cpp-httplib"
#endif
#include <httplib.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>

namespace selenograph::server {

class Connection : public httplib::Stream {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Connection(int fd);  // takes ownership of the socket
  ~Connection() override;
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  // Numeric addresses of both ends, without port; empty: unknown.
  const std::string& remote_address() const { return remote_address_; }
  const std::string& local_address() const { return local_address_; }

  // Waits for the first byte of a request. Returns false at the deadline, and after the client or end_idle() has ended
  // the connection.
  bool wait_for_request(Clock::time_point deadline);
  // All reads and writes from now on must end within `time`.
  void limit_time(std::chrono::milliseconds time) { deadline_ = Clock::now() + time; }
  // Reads return at most `bytes` from now on, and fail then.
  void limit_bytes(std::size_t bytes) { readable_bytes_ = bytes; }
  bool is_late() const { return Clock::now() >= deadline_; }
  // Bytes handed to the system since wait_for_request().
  std::size_t sent_bytes() const { return sent_bytes_; }
  // Shuts down sending, and discards received bytes for a limited time: closing at once would send a reset to a client
  // that is still sending a rejected body, and the reset would discard the answer.
  void linger();

  // While a request is in work, detect_disconnect() sets abandoned() if the client has closed its connection, or its
  // sending half.
  void begin_work();
  void end_work() { is_in_work_ = false; }
  const std::atomic<bool>& abandoned() const { return abandoned_; }

  // The following may be called from any thread.
  void detect_disconnect();
  bool end_idle();  // ends wait_for_request(); returns false while a request is received, in work or answered
  void cut();       // makes all reads and writes fail

  // Interface of the library. read() and write() return -1 at the deadline and after a disconnect.
  ssize_t read(char* to, std::size_t size) override;
  ssize_t write(const char* bytes, std::size_t size) override;
  bool is_readable() const override { return true; }
  bool is_writable() const override { return true; }
  socket_t socket() const override { return 0; }  // the library only compares it with FD_SETSIZE
  void get_remote_ip_and_port(std::string&, int&) const override {}
  void get_local_ip_and_port(std::string&, int&) const override {}

 private:
  bool wait_for(short events) const;
  bool fill();

  const int fd_;
  const std::string remote_address_, local_address_;
  std::array<char, 16384> input_;
  std::string_view unread_;  // received bytes in input_
  Clock::time_point deadline_{};
  std::size_t readable_bytes_ = 0, sent_bytes_ = 0;
  std::atomic<bool> is_idle_{false}, is_in_work_{false}, abandoned_{false};
};

}  // namespace selenograph::server
