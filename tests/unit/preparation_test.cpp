// What the next frames need: in idle time, in order, and given up for a frame that is asked for.
#include "engine/cache/preparation.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>
#include <vector>

#include "dem/base/error.h"
#include "dem/grid/geodesy.h"

namespace selenograph::engine {
namespace {

using namespace std::chrono_literals;

FrameRequest frame_at(double x) {
  FrameRequest request;
  request.camera.width = 64;
  request.pose.position_m = Vec3(x, 0, 2e6);
  return request;
}

const Preparation::IsStillCached kStillCached = [] { return true; };
constexpr auto kBudget = 1h;

// Where frames were prepared for.
class Prepared {
 public:
  Preparation::IsStillCached operator()(const FrameRequest& request) {
    const std::lock_guard lock(mutex_);
    places_.push_back(request.pose.position_m.x());
    return [this] { return still_there.load(); };
  }
  std::atomic<bool> still_there{true};
  std::vector<double> places() const {
    const std::lock_guard lock(mutex_);
    return places_;
  }

 private:
  mutable std::mutex mutex_;
  std::vector<double> places_;
};

std::vector<Pose> poses(std::initializer_list<double> places) {
  std::vector<Pose> list;
  for (const double x : places) list.push_back(frame_at(x).pose);
  return list;
}

TEST(Preparation, ReadyScenesAreNotPreparedAgain) {
  Prepared prepared;
  Preparation preparation([&](const FrameRequest& request, const StopToken&) { return prepared(request); }, kBudget);
  preparation.expect(frame_at(0), poses({10, 20, 30}));
  preparation.wait_until_done();
  preparation.expect(frame_at(10), poses({20, 30, 40}));
  preparation.wait_until_done();
  EXPECT_EQ(prepared.places(), (std::vector<double>{10, 20, 30, 40}));
  prepared.still_there = false;
  preparation.expect(frame_at(20), poses({30, 40}));
  preparation.wait_until_done();
  EXPECT_EQ(prepared.places(), (std::vector<double>{10, 20, 30, 40, 30, 40}));
}

TEST(Preparation, ExtrapolatesTheSun) {
  std::vector<Vec3> suns;
  Preparation preparation(
      [&](const FrameRequest& request, const StopToken&) {
        suns.push_back(request.sun.direction);
        return kStillCached;
      },
      kBudget);
  const auto lit = [](double degrees) {
    FrameRequest request = frame_at(0);
    request.sun.direction = AngleAxis(degrees * kRadiansPerDegree, Vec3(1, 1, 1).normalized()) * Vec3::unit_x();
    return request;
  };
  const std::vector<Pose> ahead = poses({10, 20});
  preparation.expect(lit(1), ahead);
  preparation.wait_until_done();
  preparation.expect(lit(1.01), ahead);
  preparation.wait_until_done();
  ASSERT_EQ(suns.size(), 4U);
  EXPECT_LT((suns[2] - lit(1.02).sun.direction).norm(), 1e-7);
  EXPECT_LT((suns[3] - lit(1.03).sun.direction).norm(), 1e-7);
  preparation.expect(lit(30), ahead);
  preparation.wait_until_done();
  ASSERT_EQ(suns.size(), 6U);
  EXPECT_EQ(suns[5], lit(30).sun.direction) << "it was set";
  preparation.expect(lit(30 + 1e-9), ahead);
  preparation.wait_until_done();
  EXPECT_EQ(suns.size(), 6U) << "it stands still";
}

TEST(Preparation, YieldsToAFrameAndResumes) {
  std::atomic<int> begun{0}, given_up{0};
  Preparation preparation(
      [&](const FrameRequest&, const StopToken& stop) {
        if (++begun > 1) return kStillCached;
        for (const auto limit = StopToken::Clock::now() + 20s; StopToken::Clock::now() < limit;) {
          if (stop.stopped()) ++given_up;
          stop.check();
          std::this_thread::sleep_for(1ms);
        }
        return kStillCached;
      },
      kBudget);
  preparation.expect(frame_at(0), poses({10}));
  while (begun == 0) std::this_thread::sleep_for(1ms);
  {
    const FrameRequest frame = frame_at(5);
    const Preparation::Work work(preparation, &frame);
  }
  preparation.wait_until_done();
  EXPECT_EQ(given_up, 1);
  EXPECT_EQ(begun, 2);
}

TEST(Preparation, ContinuesForTheFrameItPrepares) {
  std::atomic<bool> begun{false}, asked{false}, told{false};
  Preparation preparation(
      [&](const FrameRequest&, const StopToken& stop) {
        begun = true;
        while (!asked) std::this_thread::sleep_for(1ms);
        told = stop.stopped();
        return kStillCached;
      },
      kBudget);
  preparation.expect(frame_at(0), poses({10}));
  while (!begun) std::this_thread::sleep_for(1ms);
  {
    const FrameRequest frame = frame_at(10);
    const Preparation::Work work(preparation, &frame);
    asked = true;
  }
  preparation.wait_until_done();
  EXPECT_FALSE(told);
}

TEST(Preparation, NewPosesReplaceExpectedOnes) {
  Prepared prepared;
  Preparation preparation([&](const FrameRequest& request, const StopToken&) { return prepared(request); }, kBudget);
  FrameRequest other = frame_at(0);
  other.camera.width = 32;
  {
    const FrameRequest frame = frame_at(0);
    const Preparation::Work work(preparation, &frame);
    preparation.expect(frame_at(0), poses({10, 20}));
    preparation.expect(other, poses({77}));
    preparation.expect(frame_at(1), poses({11}));
  }
  preparation.wait_until_done();
  EXPECT_EQ(prepared.places(), (std::vector<double>{77, 11}));
}

TEST(Preparation, SimilarCamerasAreIndependent) {
  Prepared prepared;
  Preparation preparation([&](const FrameRequest& request, const StopToken&) { return prepared(request); }, kBudget);
  // A stereo pair: told apart by name alone. A third one looks elsewhere.
  FrameRequest aside = frame_at(0);
  aside.pose.camera_from_moon = AngleAxis(0.8, Vec3::unit_y());
  for (const double x : {0.0, 100.0}) {
    const FrameRequest frame = frame_at(x);
    const Preparation::Work work(preparation, &frame);
    preparation.expect(frame_at(x), poses({x + 100, x + 200}), "left");
    preparation.expect(frame_at(x + 1), poses({x + 101, x + 201}), "right");
    aside.pose.position_m = frame_at(x + 5).pose.position_m;
    preparation.expect(aside, poses({x + 105, x + 205}), "right");
  }
  preparation.wait_until_done();
  EXPECT_EQ(prepared.places(), (std::vector<double>{200, 201, 205, 300, 301, 305})) << "the soonest first";
}

TEST(Preparation, PreparationErrorsAreLeftToTheFrame) {
  Prepared prepared;
  Preparation preparation(
      [&](const FrameRequest& request, const StopToken&) {
        prepared(request);
        throw DataError("tile", "is damaged");
        return kStillCached;
      },
      kBudget);
  preparation.expect(frame_at(0), poses({10, 20}));
  preparation.wait_until_done();
  EXPECT_EQ(prepared.places(), (std::vector<double>{10, 20}));
}

TEST(Preparation, EndsWithItsBudget) {
  std::atomic<int> begun{0};
  Preparation preparation(
      [&](const FrameRequest&, const StopToken& stop) {
        for (++begun;; std::this_thread::sleep_for(1ms)) stop.check();
        return kStillCached;
      },
      20ms);
  preparation.expect(frame_at(0), poses({10, 20, 30}));
  preparation.wait_until_done();
  EXPECT_EQ(begun, 1);
}

TEST(Preparation, PausesWithoutGivingUp) {
  std::atomic<bool> begun{false}, paused{false};
  std::atomic<int> done{0};
  Preparation preparation(
      [&](const FrameRequest&, const StopToken& stop) {
        begun = true;
        while (!paused) std::this_thread::sleep_for(1ms);
        stop.check();
        ++done;
        return kStillCached;
      },
      kBudget);
  preparation.expect(frame_at(0), poses({10, 20}));
  while (!begun) std::this_thread::sleep_for(1ms);
  {
    const Preparation::Work work(preparation);
    paused = true;
    while (done == 0) std::this_thread::sleep_for(1ms);
    std::this_thread::sleep_for(20ms);
    EXPECT_EQ(done, 1) << "the second one begins afterwards";
  }
  preparation.wait_until_done();
  EXPECT_EQ(done, 2);
}

TEST(Preparation, StopsAtOnce) {
  std::atomic<bool> begun{false};
  {
    Preparation preparation(
        [&](const FrameRequest&, const StopToken& stop) {
          begun = true;
          for (;; std::this_thread::sleep_for(1ms)) stop.check();
          return kStillCached;
        },
        kBudget);
    preparation.expect(frame_at(0), poses({10}));
    while (!begun) std::this_thread::sleep_for(1ms);
  }
}

}  // namespace
}  // namespace selenograph::engine
