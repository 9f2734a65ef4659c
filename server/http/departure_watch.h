// Notices clients that leave while their frame is being rendered, so that the engine can stop.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <thread>

namespace selenograph::server {

// One thread for all connections (epoll; cpp-httplib 0.11.4 has no way to ask).
//
// A client that closes its connection and one that closes only its sending half (no more requests, but it waits for its
// response) both send FIN; they cannot be told apart until something is sent to them. Therefore an interim response
// "100 Continue" is sent, which HTTP/1.1 allows at any time and clients ignore (RFC 9110, 15.2). A closed socket
// replies with a reset, which is a departure; a half-closed one accepts it, and is probed again every few seconds in
// case it leaves later. HTTP/1.0 has no interim responses: there a FIN counts as a half-close, and only a reset as a
// departure.
class DepartureWatch {
 public:
  DepartureWatch();
  ~DepartureWatch();

  // While it exists, `*left` becomes true when the peer of socket `fd` is gone. `interim_answers`: the peer uses
  // HTTP/1.1. Nothing else may be written to the socket meanwhile.
  class Guard {
   public:
    Guard(DepartureWatch& watch, int fd, bool interim_answers, std::atomic<bool>* left);
    ~Guard();
    Guard(const Guard&) = delete;
    Guard& operator=(const Guard&) = delete;

   private:
    DepartureWatch& watch_;
    const int fd_;
    std::uint64_t id_;
  };

 private:
  struct Watched {
    int fd;
    bool interim_answers;
    std::atomic<bool>* left;
    bool half_closed = false;
  };
  void run();
  void note(std::uint64_t id, std::uint32_t events);
  void ask_again();
  static void ask(Watched& client);

  const int epoll_, wake_;
  std::mutex mutex_;
  std::map<std::uint64_t, Watched> watched_;
  std::uint64_t next_id_ = 1;  // 0 is wake_
  std::thread thread_;
};

}  // namespace selenograph::server
