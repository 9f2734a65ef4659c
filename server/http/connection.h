// One client's TCP connection: reads and writes that end by a deadline, whatever the client does.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

namespace selenograph::server {

// Minimum rate of reading: n bytes of a response must have been read within `grace` plus n / bytes_per_s.
struct SendPace {
  double bytes_per_s = 65536;
  std::chrono::milliseconds grace{10000};
};

// The peer of a connection.
struct Peer {
  std::string host;          // numeric, without port; empty: unknown
  std::string address;       // identity of the client: `host`, for IPv6 its /64; or the token named by a proxy
  std::uint64_t number = 0;  // number of the connection, from 1; 0: shared by several clients
  // Beyond --max-connections, for an address that has many: only health and metrics are served.
  bool reserved = false;
  std::string local;  // local address of the connection, numeric, without port; empty: unknown
};

class Connection {
 public:
  using Clock = std::chrono::steady_clock;

  Connection(int fd, Peer peer, const SendPace& pace);  // takes ownership of the socket
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  int fd() const { return fd_; }
  const Peer& peer() const { return peer_; }

  // Received bytes not yet consumed. Of what a client sends ahead, all but 64 KiB stays in the system's buffers.
  std::string_view unread() const { return std::string_view(input_).substr(consumed_); }
  void consume(std::size_t bytes);
  std::size_t kept_bytes() const { return input_.size(); }  // including consumed bytes before unread()
  enum class Read { data, closed, timed_out };
  // Appends received bytes to unread(), 64 KiB at most; waits for at least one byte until the deadline.
  Read fill(Clock::time_point deadline);

  // Small writes are gathered and sent with the next large one, or by flush(): head and body are sent together. All
  // writes up to flush() are one response, limited by SendPace. False: the client left or reads too slowly, or the
  // connection was cut.
  bool write(std::string_view bytes);
  bool flush();
  // Bytes of a response handed to the system so far; 0 once flush() has ended it.
  std::size_t sent_bytes() const { return sent_bytes_; }
  // Whether a part of a response has been sent that flush() has not ended.
  bool answer_begun() const { return sent_bytes_ > 0; }
  // Sends a whole answer without allocating; gathered bytes are dropped.
  bool write_without_memory(std::string_view answer);

  // Shuts down sending and reads on for a moment: a client that is still sending a rejected body would otherwise get a
  // reset instead of the answer.
  void linger(std::chrono::milliseconds at_most);

  // A connection that waits for its client may be given up to make room or to shut down; one at work may not. Both
  // sides race for the same flag. begin_work() returns false when the connection has been given up.
  bool begin_work();
  void begin_answer();  // the work is done, its response is being sent
  void end_work();
  bool give_up();  // true if this call gave it up, which ends whatever it waits for
  // Likewise for a client that has been reading its answer for kSlowAfter and at less than kSlow_bytes_per_s.
  bool give_up_if_slow(Clock::time_point now);
  // Makes all reads and writes fail from now on.
  void cut();
  bool waiting() const { return state_.load() == State::waiting; }
  // Whether it has sent nothing since it began to wait, or nothing for a moment: it is not about to begin work.
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
  std::atomic<Clock::time_point> heard_{Clock::time_point::min()};  // time of the last received bytes
};

}  // namespace selenograph::server
