// One client's TCP connection: reads and writes that end by a deadline, whatever the client does.
#pragma once

#include <sys/types.h>

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "server/http/caller.h"
#include "server/http/request_head.h"

namespace selenograph::server {

// Minimum rate at which a client must read: it has `grace` plus n / bytes_per_s for n bytes of a response.
struct SendPace {
  double bytes_per_s = 65536;
  std::chrono::milliseconds grace{10000};
};

class Connection {
 public:
  using Clock = std::chrono::steady_clock;
  static constexpr std::size_t kMaxHeadBytes = 16384;
  static constexpr std::size_t kMaxLineBytes = 8000;  // line of a head, or of the framing of chunks
  // The library of Debian 13 gives up on a head of more fields without saying why.
  static constexpr std::size_t kMaxHeadFields = 100;

  Connection(int fd, Peer peer, const SendPace& pace);  // takes ownership of the socket
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  const Peer& peer() const { return peer_; }

  // Waits for the first byte of a request, at most `idle`; returns false if none arrives. From there, the whole request
  // must arrive within `receive`.
  bool begin_request(std::chrono::milliseconds idle, std::chrono::milliseconds receive);
  // Reads received bytes, after sending all gathered output. Returns -1 if the client has closed its connection, or
  // there is a problem().
  ssize_t read(char* to, std::size_t size);
  void end_head() { in_head_ = false; }
  // Reason why read() fails: the request is late, or its head or a line is too long.
  const std::optional<Refusal>& problem() const { return problem_; }

  // Small writes are gathered and sent with the next large one, or by flush(), so that head and body share packets. All
  // writes up to flush() are one response, limited by SendPace. Both return false if the client disconnected or reads
  // too slowly, or the connection was cut.
  bool write(std::string_view bytes);
  bool flush();
  // Bytes of the current response handed to the system; 0 once flush() has ended it.
  std::size_t sent_bytes() const { return sent_bytes_; }
  // Returns true if a part of a response has been sent that flush() has not ended.
  bool answer_begun() const { return sent_bytes_ > 0; }
  // Sends a complete answer without allocating, and drops gathered bytes.
  bool write_without_memory(std::string_view answer);

  // Shuts down sending, and discards received bytes for at most `time_limit`: closing at once would send a reset to a
  // client that is still sending a rejected body, and the reset would discard the answer.
  void linger(std::chrono::milliseconds time_limit);

  // A connection that waits for its client may be given up, at the limit of connections or for shutdown; one at work
  // may not. Both transitions start from `waiting` by compare-and-swap, so that only one succeeds:
  //
  //   waiting --begin_work()--> working --end_work()--> waiting --give_up()--> given_up
  //
  // begin_work() returns false if the connection has been given up.
  bool begin_work();
  void end_work();
  bool give_up();  // true if this call gave it up, which also ends its pending read
  // Makes all reads and writes fail from now on.
  void cut();
  bool waiting() const { return state_.load() == State::waiting; }
  bool given_up() const { return state_.load() == State::given_up; }
  Clock::time_point since() const { return since_.load(); }  // start of the current wait

  // Sets abandoned() if a request is in work and the client has closed its connection, or its sending half.
  void detect_disconnect();
  const std::atomic<bool>& abandoned() const { return abandoned_; }

 private:
  enum class State { waiting, working, given_up };
  bool fill(Clock::time_point deadline);
  bool check_line_limits(char byte);
  bool send_all(std::string_view gathered, std::string_view rest);
  bool change_state(State from, State to);

  const int fd_;
  const Peer peer_;
  const SendPace pace_;
  std::array<char, 16384> input_;
  std::string_view unread_;  // received bytes in input_
  Clock::time_point receive_deadline_{};
  std::size_t head_bytes_ = 0;
  std::size_t line_bytes_ = 0;
  std::size_t head_lines_ = 0;  // with the request line, without the empty one
  bool in_head_ = true;
  bool is_late_ = false;  // the last wait ended at its deadline
  std::optional<Refusal> problem_;
  std::string output_;
  Clock::time_point answer_start_{};
  std::size_t sent_bytes_ = 0;  // of the current response
  std::atomic<State> state_{State::waiting};
  std::atomic<Clock::time_point> since_{Clock::now()};
  std::atomic<bool> abandoned_{false};
};

}  // namespace selenograph::server
