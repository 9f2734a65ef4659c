// One client's TCP connection: reads and writes that end by a deadline, whatever the client does.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <string>
#include <string_view>

namespace selenograph::server {

class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  explicit Connection(int fd);  // takes the socket over
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  int fd() const { return fd_; }

  // Bytes that came and were not consumed yet.
  std::string_view unread() const { return std::string_view(input_).substr(consumed_); }
  void consume(std::size_t bytes);
  enum class Read { data, closed, timed_out };
  // Appends what has come to unread(); waits for at least one byte until the deadline.
  Read fill(Clock::time_point deadline);

  // Small writes are gathered and leave with the next large one, or with flush(): head and body are one packet train.
  // False: the client left or takes less than 64 KiB/s after ten seconds of grace.
  bool write(std::string_view bytes);
  bool flush();

  // Says that nothing more will come and reads on for a moment: a client in the middle of sending a body that is
  // refused would otherwise get a reset instead of the answer.
  void linger(std::chrono::milliseconds at_most);

  // A connection that waits for its client may be given up to make room or to shut down; one at work may not. Both
  // sides race for the same flag. begin_work() answers false when the connection has been given up.
  bool begin_work();
  void end_work();
  bool give_up();  // true when this call gave it up: whatever it waits for ends now
  bool given_up() const { return state_.load() == State::given_up; }
  Clock::time_point waiting_since() const { return waiting_since_.load(); }

 private:
  enum class State { waiting, working, given_up };
  bool send_all(std::string_view head, std::string_view body);

  const int fd_;
  std::string input_, output_;
  std::size_t consumed_ = 0;  // of input_
  std::atomic<State> state_{State::waiting};
  std::atomic<Clock::time_point> waiting_since_{Clock::now()};
};

}  // namespace selenograph::server
