// One client's TCP connection: reads and writes that end by a deadline, whatever the client does.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace selenograph::server {

// How slowly an answer may be read: as a whole it must be gone after `grace` and its size over `bytes_per_s`.
struct SendPace {
  double bytes_per_s = 65536;
  std::chrono::milliseconds grace{10000};
};

// Who is at the other end.
struct Peer {
  std::string host;          // numeric, without port; empty: unknown
  std::string address;       // what counts as one client: that, of IPv6 its /64; or who a proxy says it is
  std::uint64_t number = 0;  // of the connection, from 1; 0: it is shared by clients
  // Beyond --max-connections, and of an address that has many: it gets health and metrics, and nothing else.
  bool reserved = false;
  std::string local;  // our own address that the connection came to, numeric, without port; empty: unknown
};

class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  Connection(int fd, Peer peer, const SendPace& pace);  // takes the socket over
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  int fd() const { return fd_; }
  const Peer& peer() const { return peer_; }

  // Bytes that came and were not consumed yet: what a client sends ahead stays in the system's buffers, but for 64 KiB.
  std::string_view unread() const { return std::string_view(input_).substr(consumed_); }
  void consume(std::size_t bytes);
  std::size_t kept_bytes() const { return input_.size(); }  // of unread() and before it
  enum class Read { data, closed, timed_out };
  // Appends what has come to unread(), 64 KiB at most; waits for at least one byte until the deadline.
  Read fill(Clock::time_point deadline);

  // Small writes are gathered and leave with the next large one, or with flush(): head and body are one packet train.
  // Everything up to flush() is one answer, and together has the time of SendPace. False: the client left, takes less,
  // or the connection was cut.
  bool write(std::string_view bytes);
  bool flush();
  // Whether bytes of an answer have left that flush() has not ended.
  bool answer_begun() const { return sent_bytes_ > 0; }
  // Sends a whole answer and allocates nothing; what was gathered is dropped.
  bool write_without_memory(std::string_view answer);

  // Says that nothing more will come and reads on for a moment: a client in the middle of sending a body that is
  // refused would otherwise get a reset instead of the answer.
  void linger(std::chrono::milliseconds at_most);

  // A connection that waits for its client may be given up to make room or to shut down; one at work may not. Both
  // sides race for the same flag. begin_work() answers false when the connection has been given up.
  bool begin_work();
  void begin_answer();  // the work is done, its answer is on its way
  void end_work();
  bool give_up();  // true when this call gave it up: whatever it waits for ends now
  // Likewise for a client that has been reading its answer for kSlowAfter and at less than kSlow_bytes_per_s.
  bool give_up_if_slow(Clock::time_point now);
  // Whatever it does: reads and writes fail from now on.
  void cut();
  bool waiting() const { return state_.load() == State::waiting; }
  // Has sent nothing since it began to wait, or nothing for a moment: it is not about to go to work.
  bool silent(Clock::time_point now) const;
  bool given_up() const { return state_.load() == State::given_up; }
  Clock::time_point since() const { return since_.load(); }  // when it began to wait, or to answer

  static constexpr auto kSlowAfter = std::chrono::seconds(5);
  static constexpr double kSlow_bytes_per_s = 1 << 20;

 private:
  enum class State { waiting, working, answering, given_up };
  bool send_all(std::string_view head, std::string_view body);
  bool move_on(State from, State to);

  const int fd_;
  const Peer peer_;
  const SendPace pace_;
  std::string input_, output_;
  std::size_t consumed_ = 0;  // of input_
  Clock::time_point answer_start_{};
  std::atomic<std::size_t> sent_bytes_{0};  // of this answer
  std::atomic<State> state_{State::waiting};
  std::atomic<Clock::time_point> since_{Clock::now()};
  std::atomic<Clock::time_point> heard_{Clock::time_point::min()};  // when bytes came last
};

}  // namespace selenograph::server
