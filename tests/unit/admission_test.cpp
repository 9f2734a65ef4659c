#include "api/message/admission.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "api/message/problem.h"
#include "api/service.h"
#include "dem/base/error.h"
#include "engine/renderer.h"
#include "tests/support/float_tiles.h"
#include "tests/support/shared_data.h"

namespace selenograph::api {
namespace {

using Clock = Admission::Clock;
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

std::string code_of(const auto& work) {
  try {
    work();
  } catch (const RequestError& e) {
    return e.code();
  } catch (const Cancelled&) {
    return "cancelled";
  }
  return "";
}

// Returns the error of a request that takes `bytes`; empty: it was admitted, and has finished.
std::string enter(Admission& admission, const std::string& client = kSomebody, std::size_t bytes = 0,
                  const StopToken& stop = StopToken(far_away())) {
  return code_of([&] { admission.enter(client, bytes, stop); });
}

TEST(Admission, AdmitsUpToTheBoundAndRefusesBeyondTheQueue) {
  Admission admission({.max_in_work = 2, .max_waiting = 0});
  const auto a = admission.enter(kSomebody, 0, {});
  auto b = admission.enter(kSomebody, 0, {});
  EXPECT_EQ(admission.in_work(), 2);
  EXPECT_EQ(enter(admission), "busy");
  b.finish(0);
  EXPECT_EQ(admission.in_work(), 1);
  EXPECT_EQ(enter(admission), "");
  EXPECT_EQ(admission.in_work(), 1);
}

TEST(Admission, ADeadlineEndsTheWait) {
  Admission admission({.max_in_work = 1, .max_waiting = 1});
  const auto holder = admission.enter(kSomebody, 0, {});
  EXPECT_EQ(enter(admission, kSomebody, 0, StopToken(Clock::now() + milliseconds(20))), "cancelled");
  EXPECT_EQ(admission.waiting(), 0);
}

TEST(Admission, DepartedClientsLeaveTheQueue) {
  Admission admission({.max_in_work = 1, .max_waiting = 1});
  const auto holder = admission.enter(kSomebody, 0, {});
  std::atomic<bool> left{false};
  auto waiting =
      std::async(std::launch::async, [&] { return enter(admission, kSomebody, 0, StopToken(far_away(), &left)); });
  until([&] { return admission.waiting() == 1; });
  left = true;
  EXPECT_EQ(waiting.get(), "cancelled");
  EXPECT_EQ(admission.waiting(), 0);
}

TEST(Admission, NobodyOvertakesTheQueueWhenItsFrontGivesUp) {
  Admission admission({.max_in_work = 1, .max_waiting = 4});
  std::optional<Admission::Permit> holder(admission.enter(kSomebody, 0, {}));
  std::atomic<bool> left{false};
  auto first =
      std::async(std::launch::async, [&] { return enter(admission, kSomebody, 0, StopToken(far_away(), &left)); });
  until([&] { return admission.waiting() == 1; });
  auto second = std::async(std::launch::async, [&] { return enter(admission); });
  until([&] { return admission.waiting() == 2; });
  left = true;
  EXPECT_EQ(first.get(), "cancelled");
  holder.reset();
  EXPECT_EQ(second.get(), "");
}

TEST(Admission, ClosingRefusesNewcomersAndLetsTheOthersFinish) {
  Admission admission({.max_in_work = 1, .max_waiting = 1});
  std::optional<Admission::Permit> holder(admission.enter(kSomebody, 0, {}));
  auto queued = std::async(std::launch::async, [&] { return enter(admission); });
  until([&] { return admission.waiting() == 1; });
  admission.close();
  EXPECT_EQ(enter(admission), "shutting_down");
  EXPECT_FALSE(admission.wait_until_idle(Clock::now() + milliseconds(10)));
  holder.reset();
  EXPECT_EQ(queued.get(), "");
  EXPECT_TRUE(admission.wait_until_idle(far_away()));
}

TEST(Admission, RetryAfterGrowsWithTheQueueAndStaysWithinBounds) {
  Admission admission({.max_in_work = 1, .max_waiting = 400});
  EXPECT_GE(admission.retry_after_s(), 1);
  const auto holder = admission.enter(kSomebody, 0, {});
  std::atomic<bool> left{false};
  std::vector<std::future<void>> queue;
  for (int i = 0; i < 20; ++i)
    queue.push_back(std::async(std::launch::async, [&, i] {
      enter(admission, "192.0.2." + std::to_string(i), 0, StopToken(far_away(), &left));
    }));
  until([&] { return admission.waiting() == 20; });
  EXPECT_EQ(admission.retry_after_s(), 11) << "half a second each, until there is a measurement";
  left = true;
}

// Requests that wait, each on a thread of its own, and their clients in the order of admission.
class Queue {
 public:
  explicit Queue(Admission& admission) : admission_(admission) {}
  ~Queue() { finish(); }
  void add(const std::string& client, std::size_t bytes = 0) {
    const int waiting = admission_.waiting();
    threads_.emplace_back([this, client, bytes] {
      const auto permit = admission_.enter(client, bytes, StopToken(far_away()));
      const std::lock_guard lock(mutex_);
      entered_.push_back(client);
    });
    until([&] { return admission_.waiting() == waiting + 1; });
  }
  void finish() {
    for (std::thread& thread : threads_) thread.join();
    threads_.clear();
  }
  std::vector<std::string> entered() {
    const std::lock_guard lock(mutex_);
    return entered_;
  }

 private:
  Admission& admission_;
  std::mutex mutex_;
  std::vector<std::thread> threads_;
  std::vector<std::string> entered_;
};

TEST(AdmissionByClients, ClientsTakeTurns) {
  Admission admission({.max_in_work = 1, .max_waiting = 16});
  std::optional<Admission::Permit> holder(admission.enter(kSomebody, 0, {}));
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
  std::optional<Admission::Permit> holder(admission.enter(kSomebody, 0, {}));
  Queue queue(admission);
  for (int i = 0; i < 2; ++i) queue.add("a");
  EXPECT_EQ(enter(admission, "a"), "busy") << "half of the queue is its own";
  queue.add("b");
  EXPECT_EQ(enter(admission, "b"), "busy");
  queue.add("c");
  EXPECT_EQ(enter(admission, "d"), "busy") << "no place is left";
  holder.reset();
  queue.finish();
  EXPECT_EQ(queue.entered(), (std::vector<std::string>{"a", "b", "c", "a"}));
}

TEST(AdmissionOfMemory, BytesAreReturnedOnce) {
  Admission admission({.max_bytes = 100});
  {
    auto first = admission.enter(kSomebody, 60, {});
    EXPECT_EQ(code_of([&] { admission.claim(41); }), "busy");
    auto second = admission.claim(40);
    EXPECT_EQ(admission.bytes_in_use(), 100U);
    const Admission::Permit moved = std::move(second);
    EXPECT_EQ(admission.bytes_in_use(), 100U);
    first.finish(10);
    EXPECT_EQ(admission.bytes_in_use(), 50U);
    EXPECT_EQ(admission.in_work(), 0) << "its answer holds memory, and no slot";
    first.finish(200);  // an answer larger than expected exists already
    EXPECT_EQ(admission.bytes_in_use(), 240U);
    EXPECT_EQ(code_of([&] { admission.claim(0); }), "busy");
  }
  EXPECT_EQ(admission.bytes_in_use(), 0U);
}

TEST(AdmissionOfMemory, SmallRequestsPassLargeOnesThatDoNotFit) {
  Admission admission({.max_in_work = 2, .max_waiting = 8, .max_bytes = 100});
  auto unread = admission.enter(kSomebody, 80, {});
  unread.finish(80);
  Queue queue(admission);
  queue.add("a", 50);
  queue.add("b", 60);
  EXPECT_EQ(enter(admission, "a", 20), "") << "of a client whose older request waits";
  EXPECT_EQ(enter(admission, "c", 20), "");
  EXPECT_EQ(admission.in_work(), 0) << "who waits for memory holds no slot";
  unread.finish(0);
  queue.finish();
  EXPECT_EQ(queue.entered(), (std::vector<std::string>{"a", "b"}));
}

TEST(AdmissionOfMemory, WhatFitsFirstIsByTurns) {
  Admission admission({.max_in_work = 1, .max_waiting = 16, .max_bytes = 100});
  std::optional<Admission::Permit> holder(admission.enter(kSomebody, 0, {}));
  auto unread = admission.claim(50);
  Queue queue(admission);
  queue.add("a", 60);
  queue.add("a", 10);
  queue.add("b", 10);
  holder.reset();
  until([&] { return queue.entered().size() == 2; });
  EXPECT_EQ(queue.entered(), (std::vector<std::string>{"a", "b"})) << "its small one";
  unread.finish(0);
  queue.finish();
  EXPECT_EQ(queue.entered().back(), "a");
}

TEST(Admission, NeverMoreThanAllowed) {
  Admission admission({.max_in_work = 3, .max_waiting = 100, .max_bytes = 1000});
  std::atomic<int> in_work{0}, most_in_work{0};
  std::atomic<std::size_t> held{0}, most_held{0};
  const auto raise = [](auto& most, auto value) {
    for (auto before = most.load(); value > before && !most.compare_exchange_weak(before, value);) {
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 12; ++t) {
    threads.emplace_back([&, t] {
      for (std::size_t i = 0; i < 50; ++i) {
        const std::size_t bytes = 1 + (t * 131 + i * 57) % 600;
        const auto permit = admission.enter(kSomebody, bytes, StopToken(far_away()));
        raise(most_in_work, ++in_work);
        raise(most_held, held += bytes);
        std::this_thread::yield();
        held -= bytes;
        --in_work;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_LE(most_in_work, 3);
  EXPECT_LE(most_held, 1000U);
  EXPECT_EQ(admission.in_work(), 0);
  EXPECT_EQ(admission.bytes_in_use(), 0U);
}

TEST(AdmissionOfMemory, AnAnswerOutlivesItsService) {
  const test::TemporaryFolder folder;
  test::write_global_tile(folder / "dem", 1, [](double, double) { return 0.0; });
  auto admission = std::make_shared<Admission>(AdmissionLimits{.max_bytes = std::size_t{1} << 30});
  const std::weak_ptr<Admission> known = admission;
  Response answer;
  {
    const auto renderer = std::make_shared<engine::Renderer>(test::open_terrain(folder / "dem"),
                                                             engine::RendererOptions{1, std::size_t{256} << 20});
    Request request;
    request.method = "GET";
    request.path = "/v1/datasets";
    answer = Service(renderer, {}, {}, {}, std::move(admission)).handle(request);
  }
  EXPECT_EQ(answer.status, 200) << answer.body;
  ASSERT_FALSE(known.expired()) << "the service's end";
  EXPECT_GT(known.lock()->bytes_in_use(), 0U);
  answer = {};
  EXPECT_TRUE(known.expired());
}

}  // namespace
}  // namespace selenograph::api
