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

const Admission::Visitor kSomebody{"192.0.2.1", 1};

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
  Admission admission({.max_in_work = 1, .max_waiting = 8});
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
  Admission admission({.max_in_work = 1, .max_waiting = 2});
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
    queue.push_back(std::async(std::launch::async, [&, i] {
      admission.enter({"192.0.2." + std::to_string(i), static_cast<std::uint64_t>(100 + i)}, far_away(), &left);
    }));
  until([&] { return admission.waiting() == 20; });
  EXPECT_GT(admission.retry_after_s(), 1);
  EXPECT_LE(admission.retry_after_s(), 120);
  left = true;
}

// Requests that wait, each on a thread of its own; who entered is noted in order.
class Queue {
 public:
  explicit Queue(Admission& admission) : admission_(admission) {}
  ~Queue() { finish(); }
  void add(const Admission::Visitor& visitor) {
    const int waiting = admission_.waiting();
    threads_.emplace_back([this, visitor] {
      const auto entry = admission_.enter(visitor, far_away(), nullptr);
      const std::lock_guard lock(mutex_);
      if (entry.outcome == Outcome::admitted) entered_.push_back(visitor.client);
      if (entry.outcome == Outcome::full) refused_.push_back(entry.retry_after_s);
    });
    until([&] { return admission_.waiting() == waiting + 1 || refused() > 0; });
  }
  void finish() {
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }
  std::vector<std::string> entered() const { return entered_; }
  std::size_t refused() const {
    const std::lock_guard lock(mutex_);
    return refused_.size();
  }

 private:
  Admission& admission_;
  mutable std::mutex mutex_;
  std::vector<std::thread> threads_;
  std::vector<std::string> entered_;
  std::vector<int> refused_;
};

TEST(AdmissionByClients, ClientsTakeTurns) {
  Admission admission({.max_in_work = 1, .max_waiting = 16});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  Queue queue(admission);
  for (int i = 0; i < 4; ++i) queue.add({"a"});
  for (int i = 0; i < 2; ++i) queue.add({"b"});
  queue.add({"c"});
  holder.reset();
  queue.finish();
  EXPECT_EQ(queue.entered(), (std::vector<std::string>{"a", "b", "c", "a", "b", "a", "a"}));
}

TEST(AdmissionByClients, FullQueueMakesRoomForClientsWithFewerRequests) {
  Admission admission({.max_in_work = 1, .max_waiting = 4});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  {
    Queue queue(admission);
    for (int i = 0; i < 4; ++i) queue.add({"a"});
    EXPECT_EQ(admission.enter({"a"}, far_away(), nullptr).outcome, Outcome::full) << "not for itself";
    std::thread other([&] { EXPECT_EQ(admission.enter({"b"}, far_away(), nullptr).outcome, Outcome::admitted); });
    until([&] { return queue.refused() == 1; });
    EXPECT_EQ(admission.waiting(), 4);
    holder.reset();
    other.join();
    queue.finish();
    EXPECT_EQ(queue.entered().size(), 3u);
  }
}

TEST(AdmissionByClients, RetryAfterIsThePlaceInTheQueueTimesTheMeanDuration) {
  Admission admission({.max_in_work = 1, .max_waiting = 2});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  Queue queue(admission);
  for (int i = 0; i < 2; ++i) queue.add({"a"});
  // Half a second each, until there is a measurement; promises stand in the queue, too.
  std::vector<int> times;
  for (std::uint64_t i = 0; i < 6; ++i) {
    const auto entry = admission.enter({"a", 10 + i}, far_away(), nullptr);
    EXPECT_EQ(entry.outcome, Outcome::full);
    times.push_back(entry.retry_after_s);
  }
  EXPECT_EQ(times, (std::vector{2, 2, 3, 3, 4, 4}));
  holder.reset();
}

// Those who are served and ask again at once don't take what was promised to others, who may come on a new connection.
class PromisedPlace : public ::testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(OnTheSameAndOnANewConnection, PromisedPlace, ::testing::Values(3, 4));

TEST_P(PromisedPlace, IsKept) {
  Admission admission({.max_in_work = 1, .max_waiting = 1});
  std::optional<Admission::Entry> holder(admission.enter({"a", 1}, far_away(), nullptr));
  std::atomic<bool> left{false};
  auto waiting = std::async(std::launch::async, [&] { return admission.enter({"a", 2}, far_away(), &left).outcome; });
  until([&] { return admission.waiting() == 1; });
  const auto promised = admission.enter({"a", 3}, far_away(), nullptr);
  EXPECT_EQ(promised.outcome, Outcome::full);
  EXPECT_GE(promised.retry_after_s, 1);
  left = true;
  EXPECT_EQ(waiting.get(), Outcome::abandoned);
  ASSERT_EQ(admission.waiting(), 0);
  // There is room in the queue, and it is not theirs.
  EXPECT_EQ(admission.enter({"a", 1}, far_away(), nullptr).outcome, Outcome::full);
  EXPECT_EQ(admission.enter({"a", 2}, far_away(), nullptr).outcome, Outcome::full);
  EXPECT_EQ(admission.enter({"a", 3}, far_away(), nullptr).outcome, Outcome::full) << "too early";
  std::this_thread::sleep_for(std::chrono::seconds(promised.retry_after_s));
  auto returned = std::async(std::launch::async, [&] {
    return admission.enter({"a", static_cast<std::uint64_t>(GetParam())}, far_away(), nullptr).outcome;
  });
  until([&] { return admission.waiting() == 1; });
  holder.reset();
  EXPECT_EQ(returned.get(), Outcome::admitted);
}

TEST(AdmissionByClients, RefusesAtOnceWhenTheWaitIsTooLong) {
  Admission admission({.max_in_work = 1, .max_waiting = 100, .patience = milliseconds(1200)});
  std::optional<Admission::Entry> holder(admission.enter(kSomebody, far_away(), nullptr));
  Queue queue(admission);
  for (int i = 0; i < 2; ++i) queue.add({"a"});
  EXPECT_EQ(admission.enter({"a"}, far_away(), nullptr).outcome, Outcome::full);
  holder.reset();
}

// 30 clients of one address, a queue of 4: all obey Retry-After, and all are served however often the others ask again.
TEST(AdmissionByClients, ClientsThatObeyRetryAfterAreServed) {
  Admission admission({.max_in_work = 2, .max_waiting = 4});
  std::atomic<int> unserved{30};
  std::vector<std::thread> threads;
  for (std::uint64_t i = 1; i <= 30; ++i) {
    threads.emplace_back([&, i] {
      for (bool served = false; unserved > 0;) {
        const auto entry = admission.enter({"a", i}, far_away(), nullptr);
        if (entry.outcome == Outcome::full) {
          std::this_thread::sleep_for(std::chrono::seconds(entry.retry_after_s));
          continue;
        }
        std::this_thread::sleep_for(milliseconds(20));
        if (!served) --unserved;
        served = true;
      }
    });
  }
  const auto start = Clock::now();
  until([&] { return unserved == 0; });
  EXPECT_LT(std::chrono::duration<double>(Clock::now() - start).count(), 40);
  for (std::thread& thread : threads) thread.join();
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
