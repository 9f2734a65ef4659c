// Who may render now: a bounded number of requests in work and a bounded queue behind them, shared fairly by clients.
//
// A client is an address. Within a client the oldest request enters first, and clients take turns: one that sends 200
// requests at once delays another's single one by one request. When the queue is full, the newest request of the client
// with most of it gives way to one of a client with fewer.
//
// Who is refused is told when to come back: when a newcomer may expect to enter, behind those who wait and those who
// were told so before. His place is kept for a while (a promise), so that clients who are served and ask again at once
// don't take it meanwhile. It is his who comes back on the same connection, or of the same client on a new one.
#pragma once

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <list>
#include <map>
#include <mutex>
#include <string>

namespace selenograph::server {

struct AdmissionLimits {
  int max_in_work = 1;  // at least 1
  int max_waiting = 0;  // and promised places
  // Who would wait longer than this (by the mean time that requests take) is rather told when to come back.
  std::chrono::milliseconds patience{60000};
};

// All members may be called from any thread.
class Admission {
 public:
  using Clock = std::chrono::steady_clock;

  enum class Outcome {
    admitted,
    full,       // no place in the queue, or it was given to a client with fewer: see Entry::retry_after_s
    closing,    // close() was called
    expired,    // the deadline passed in the queue
    abandoned,  // the client left while queueing
  };

  struct Visitor {
    std::string client;            // takes turns with others
    std::uint64_t connection = 0;  // who comes back on it is the same
  };

  // A place in work, given back on destruction. Empty unless the outcome is `admitted`.
  class Place {
   public:
    Place() = default;
    Place(Place&& other) noexcept;
    Place& operator=(Place&&) = delete;
    ~Place();

   private:
    friend class Admission;
    explicit Place(Admission* admission) : admission_(admission), since_(Clock::now()) {}
    Admission* admission_ = nullptr;
    Clock::time_point since_{};
  };

  struct Entry {
    Outcome outcome;
    Place place;
    int retry_after_s = 0;  // of `full` and `closing`
  };

  explicit Admission(const AdmissionLimits& limits);

  // Waits in the queue until a place is free; no longer than the deadline, and not when `*abandoned` (null: never) is
  // true.
  Entry enter(const Visitor& visitor, Clock::time_point deadline, const std::atomic<bool>* abandoned);

  // Refuses newcomers from now on; those in work and in the queue go on.
  void close();
  // True once nobody is in work or waiting; false when the deadline comes first.
  bool wait_until_idle(Clock::time_point deadline);

  int in_work() const;
  int waiting() const;
  int max_in_work() const { return limits_.max_in_work; }
  int max_waiting() const { return limits_.max_waiting; }

  // When a client that has nothing here may find a place. Whole seconds, 1 to 120. Nothing is promised by it.
  int retry_after_s() const;

 private:
  struct Waiting {
    bool displaced = false;
  };
  struct Promise {
    std::uint64_t connection;  // that it was made to
    std::uint64_t newest;      // connection at that time: those that came later may be the same client's
    Clock::time_point due;
  };
  struct Client {
    std::list<Waiting*> waiting;  // oldest first
    std::list<Promise> promises;  // oldest first
    std::uint64_t turn = 0;       // drawn when it came and with each request that enters: the least is next
    std::size_t size() const { return waiting.size() + promises.size(); }
  };
  using Clients = std::map<std::string, Client>;

  void leave(Clock::duration took);
  Entry wait_in_queue(const Visitor& visitor, Clock::time_point deadline, const std::atomic<bool>* abandoned,
                      std::unique_lock<std::mutex>& lock);
  Client& client_of(const Visitor& visitor);
  bool join(Client& client, const Visitor& visitor, Waiting& me);
  bool take_promise(Client& client, const Visitor& visitor);
  bool make_room_for(const Client& client);
  int promise(const Visitor& visitor);
  void forget_late_promises();
  std::size_t promised_soon() const;
  bool is_next(const Waiting* me) const;
  std::size_t ahead_of(const Client* client) const;
  double wait_s(std::size_t ahead) const;
  int come_back_after_s(std::size_t ahead) const;

  const AdmissionLimits limits_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  Clients clients_;  // those that wait or have a promise
  std::size_t waiting_ = 0;
  std::uint64_t turns_ = 0, newest_ = 0;
  int in_work_ = 0;
  bool closing_ = false;
  double mean_s_ = 0.5;  // of a place's use, moving average
};

}  // namespace selenograph::server
