// Admission control: a bounded number of active requests and a bounded queue, shared fairly by clients.
//
// A client is an address. Within a client the oldest request enters first, and clients take turns: one that sends 200
// requests at once delays another's single one by one request. When the queue is full, the newest request of the client
// with the most requests in it makes room for one of a client with fewer.
//
// A refused client is told when to retry: when a newcomer may expect to enter, behind those in the queue and those
// promised before. Its place is reserved for a while (a promise), so that clients who are served and ask again at once
// do not take it. It is identified by its connection, or by a new connection of the same client.
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
  int max_waiting = 0;  // including promised places
  // A client that would wait longer than this, by the mean time of requests, is told to retry instead.
  std::chrono::milliseconds patience{60000};
};

// Thread-safe.
class Admission {
 public:
  using Clock = std::chrono::steady_clock;

  enum class Outcome {
    admitted,
    full,       // queue full, or the place went to a client with fewer: see Entry::retry_after_s
    closing,    // close() was called
    expired,    // the deadline passed in the queue
    abandoned,  // the client left while queueing
  };

  struct Visitor {
    std::string client;            // identity of the client, for taking turns
    std::uint64_t connection = 0;  // identifies a returning client
  };

  // Permission to work, returned on destruction. Empty unless the outcome is `admitted`.
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

  // Waits in the queue until a place is free; no longer than the deadline, and not if `*abandoned` (null: never) is
  // true.
  Entry enter(const Visitor& visitor, Clock::time_point deadline, const std::atomic<bool>* abandoned);

  // Refuses new requests from now on; active and queued ones continue.
  void close();
  // True once no request is active or queued; false if the deadline comes first.
  bool wait_until_idle(Clock::time_point deadline);

  int in_work() const;
  int waiting() const;
  int max_in_work() const { return limits_.max_in_work; }
  int max_waiting() const { return limits_.max_waiting; }

  // Estimated time until a new client may find a place. Whole seconds, 1 to 120. Promises nothing.
  int retry_after_s() const;

 private:
  struct Waiting {
    bool displaced = false;
  };
  struct Promise {
    std::uint64_t connection;  // that it was promised to
    std::uint64_t newest;      // latest connection then: later ones may be the same client's
    Clock::time_point due;
  };
  struct Client {
    std::list<Waiting*> waiting;  // oldest first
    std::list<Promise> promises;  // oldest first
    std::uint64_t turn = 0;       // drawn on arrival and for each request that enters: the lowest is next
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
  double mean_s_ = 0.5;  // moving average of the time per request
};

}  // namespace selenograph::server
