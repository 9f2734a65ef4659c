#include "server/service/admission.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

namespace selenograph::server {
namespace {

using Clock = Admission::Clock;
using Outcome = Admission::Outcome;
using std::chrono::milliseconds;

Clock::time_point far_away() { return Clock::now() + std::chrono::minutes(1); }

const std::string kSomebody = "192.0.2.1";

// Waits for a state that other threads bring about; by state, not by time.
template <typename Condition>
void until(Condition condition) {
  const auto give_up = far_away();
  while (!condition() && Clock::now() < give_up) std::this_thread::sleep_for(milliseconds(1));
  ASSERT_TRUE(condition());
}

TEST(Admission, AdmitsUpToTheBoundAndRefusesBeyondTheQueue) {
  Admission admission({.max_in_work = 2, .max_waiting = 0});
  const auto a = admission.enter(kSomebody, far_away(), nullptr);
  const auto b = admission.enter(kSomebody, far_away(), nullptr);
  EXPECT_EQ(a.outcome, Outcome::admitted);
  EXPECT_EQ(b.outcome, Outcome::admitted);
  EXPECT_EQ(admission.in_work(), 2);
  EXPECT_EQ(admission.enter(kSomebody, far_away(), nullptr).outcome, Outcome::full);
}

TEST(Admission, APlaceIsGivenBack) {
  Admission admission({.max_in_work = 1, .max_waiting = 0});
  { const auto entry = admission.enter(kSomebody, far_away(), nullptr); }
  EXPECT_EQ(admission.in_work(), 0);
  EXPECT_EQ(admission.enter(kSomebody, far_away(), nullptr).outcome, Outcome::admitted);
}

TEST(Admission, FirstComeFirstServed) {
  Admission admission({.max_in_work = 1, .max_waiting = 16});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  std::mutex mutex;
  std::vector<int> order;
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i) {
    threads.emplace_back([&, i] {
      const auto entry = admission.enter(kSomebody, far_away(), nullptr);
      const std::lock_guard lock(mutex);
      order.push_back(i);
    });
    until([&] { return admission.waiting() == i + 1; });
  }
  holder.reset();
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(order, (std::vector{0, 1, 2, 3, 4, 5, 6, 7}));
}

TEST(Admission, ADeadlineEndsTheWait) {
  Admission admission({.max_in_work = 1, .max_waiting = 1});
  const auto holder = admission.enter(kSomebody, far_away(), nullptr);
  EXPECT_EQ(admission.enter(kSomebody, Clock::now() + milliseconds(20), nullptr).outcome, Outcome::expired);
  EXPECT_EQ(admission.waiting(), 0);
}

TEST(Admission, DepartedClientsLeaveTheQueue) {
  Admission admission({.max_in_work = 1, .max_waiting = 1});
  const auto holder = admission.enter(kSomebody, far_away(), nullptr);
  std::atomic<bool> left{false};
  auto waiting = std::async(std::launch::async, [&] { return admission.enter(kSomebody, far_away(), &left).outcome; });
  until([&] { return admission.waiting() == 1; });
  left = true;
  EXPECT_EQ(waiting.get(), Outcome::abandoned);
  EXPECT_EQ(admission.waiting(), 0);
}

TEST(Admission, NobodyOvertakesTheQueueWhenItsFrontGivesUp) {
  Admission admission({.max_in_work = 1, .max_waiting = 4});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  std::atomic<bool> left{false};
  auto first = std::async(std::launch::async, [&] { return admission.enter(kSomebody, far_away(), &left).outcome; });
  until([&] { return admission.waiting() == 1; });
  auto second = std::async(std::launch::async, [&] { return admission.enter(kSomebody, far_away(), nullptr).outcome; });
  until([&] { return admission.waiting() == 2; });
  left = true;
  EXPECT_EQ(first.get(), Outcome::abandoned);
  holder.reset();
  EXPECT_EQ(second.get(), Outcome::admitted);
}

TEST(Admission, ClosingRefusesNewcomersAndLetsTheOthersFinish) {
  Admission admission({.max_in_work = 1, .max_waiting = 1});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  auto queued = std::async(std::launch::async, [&] { return admission.enter(kSomebody, far_away(), nullptr).outcome; });
  until([&] { return admission.waiting() == 1; });
  admission.close();
  EXPECT_EQ(admission.enter(kSomebody, far_away(), nullptr).outcome, Outcome::closing);
  EXPECT_FALSE(admission.wait_until_idle(Clock::now() + milliseconds(10)));
  holder.reset();
  EXPECT_EQ(queued.get(), Outcome::admitted);
  EXPECT_TRUE(admission.wait_until_idle(far_away()));
}

TEST(Admission, RetryAfterGrowsWithTheQueueAndStaysWithinBounds) {
  Admission admission({.max_in_work = 1, .max_waiting = 400});
  EXPECT_GE(admission.retry_after_s(), 1);
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  std::atomic<bool> left{false};
  std::vector<std::future<void>> queue;
  for (int i = 0; i < 20; ++i)
    queue.push_back(
        std::async(std::launch::async, [&, i] { admission.enter("192.0.2." + std::to_string(i), far_away(), &left); }));
  until([&] { return admission.waiting() == 20; });
  EXPECT_GT(admission.retry_after_s(), 1);
  EXPECT_LE(admission.retry_after_s(), 120);
  left = true;
}

// Requests that wait, each on a thread of its own, and their clients in the order of admission.
class Queue {
 public:
  explicit Queue(Admission& admission) : admission_(admission) {}
  ~Queue() { finish(); }
  void add(const std::string& client) {
    const int waiting = admission_.waiting();
    threads_.emplace_back([this, client] {
      const auto entry = admission_.enter(client, far_away(), nullptr);
      const std::lock_guard lock(mutex_);
      if (entry.outcome == Outcome::admitted) entered_.push_back(client);
    });
    until([&] { return admission_.waiting() == waiting + 1; });
  }
  void finish() {
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }
  std::vector<std::string> entered() const { return entered_; }

 private:
  Admission& admission_;
  std::mutex mutex_;
  std::vector<std::thread> threads_;
  std::vector<std::string> entered_;
};

TEST(AdmissionByClients, ClientsTakeTurns) {
  Admission admission({.max_in_work = 1, .max_waiting = 16});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  Queue queue(admission);
  for (int i = 0; i < 4; ++i) queue.add("a");
  for (int i = 0; i < 2; ++i) queue.add("b");
  queue.add("c");
  holder.reset();
  queue.finish();
  EXPECT_EQ(queue.entered(), (std::vector<std::string>{"a", "b", "c", "a", "b", "a", "a"}));
}

TEST(AdmissionByClients, APlaceRemainsForANewcomer) {
  Admission admission({.max_in_work = 1, .max_waiting = 4});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  Queue queue(admission);
  for (int i = 0; i < 2; ++i) queue.add("a");
  EXPECT_EQ(admission.enter("a", far_away(), nullptr).outcome, Outcome::full) << "half of the queue is its own";
  queue.add("b");
  EXPECT_EQ(admission.enter("b", far_away(), nullptr).outcome, Outcome::full);
  queue.add("c");
  EXPECT_EQ(admission.enter("d", far_away(), nullptr).outcome, Outcome::full) << "no place is left";
  holder.reset();
  queue.finish();
  EXPECT_EQ(queue.entered(), (std::vector<std::string>{"a", "b", "c", "a"}));
}

TEST(AdmissionByClients, RetryAfterIsTheQueueTimesTheMeanDuration) {
  Admission admission({.max_in_work = 1, .max_waiting = 8});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  Queue queue(admission);
  for (int i = 0; i < 4; ++i) queue.add("a");
  // Half a second each, until there is a measurement.
  EXPECT_EQ(admission.enter("a", far_away(), nullptr).retry_after_s, 3);
  holder.reset();
}

TEST(Admission, NeverMoreActiveThanAllowed) {
  Admission admission({.max_in_work = 3, .max_waiting = 100});
  std::atomic<int> now{0}, most{0}, admitted{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 12; ++i) {
    threads.emplace_back([&] {
      for (int k = 0; k < 50; ++k) {
        const auto entry = admission.enter(kSomebody, far_away(), nullptr);
        if (entry.outcome != Outcome::admitted) continue;
        ++admitted;
        const int mine = ++now;
        int seen = most;
        while (mine > seen && !most.compare_exchange_weak(seen, mine)) {
        }
        std::this_thread::yield();
        --now;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(admitted, 600);
  EXPECT_LE(most, 3);
  EXPECT_EQ(admission.in_work(), 0);
}

}  // namespace
}  // namespace selenograph::server
