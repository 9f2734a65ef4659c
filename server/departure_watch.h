// Notices clients that leave while their frame is being rendered, so that the engine can stop.
#pragma once

#include <atomic>
#include <cstdint>
#include <map>
#include <mutex>
#include <thread>

namespace selenograph::server {

// One thread for all connections (epoll; cpp-httplib 0.11.4 has no way to ask). A client that only closes its sending
// half counts as gone, as with most HTTP servers.
class DepartureWatch {
 public:
  DepartureWatch();
  ~DepartureWatch();

  // While it lives, `*left` becomes true when the peer of socket `fd` is gone.
  class Guard {
   public:
    Guard(DepartureWatch& watch, int fd, std::atomic<bool>* left);
    ~Guard();
    Guard(const Guard&) = delete;
    Guard& operator=(const Guard&) = delete;

   private:
    DepartureWatch& watch_;
    const int fd_;
    std::uint64_t id_;
  };

 private:
  void run();
  const int epoll_, wake_;
  std::mutex mutex_;
  std::map<std::uint64_t, std::atomic<bool>*> watched_;
  std::uint64_t next_id_ = 1;  // 0 is wake_
  std::thread thread_;
};

}  // namespace selenograph::server
