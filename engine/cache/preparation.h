// Prepares scenes of expected frames in idle time, on a budget of time for each frame and of memory for all
// (RenderCache). It never changes a byte of any answer.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <thread>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Counts of prepared scenes: made, used by a frame, evicted unused.
struct PreparationStatistics {
  std::uint64_t prepared = 0, used = 0, wasted = 0;
};

// Thread-safe.
class Preparation {
 public:
  // Whether the prepared scene is still cached; marks it as used.
  using StillThere = std::function<bool()>;
  // Makes the scene of a frame; throws Cancelled when stopped. Other exceptions are ignored: the frame itself will
  // report them.
  using Prepare = std::function<StillThere(const FrameRequest&, const StopToken&)>;
  // `budget`: the time for all that one frame expects, repetitions included.
  Preparation(Prepare prepare, StopToken::Clock::duration budget);
  ~Preparation();
  Preparation(const Preparation&) = delete;
  Preparation& operator=(const Preparation&) = delete;

  // Marks active work: while any exists, nothing new is prepared.
  class Work {
   public:
    // Lets a preparation in progress continue.
    explicit Work(Preparation& preparation);
    // Cancels a preparation in progress unless it is for this very frame: its pose and Sun. `frame`: null for other
    // work.
    Work(Preparation& preparation, const FrameRequest* frame);
    ~Work();
    Work(const Work&) = delete;
    Work& operator=(const Work&) = delete;

   private:
    Preparation& preparation_;
  };

  // Called after a frame: the poses at which its camera is expected next, soonest first. If empty, the camera's motion
  // since the previous frame is extrapolated; the Sun's always is. Replaces earlier expectations for this camera.
  // `name` distinguishes identical cameras.
  void expect(const FrameRequest& frame, std::span<const Pose> ahead, std::string_view name = {});

  // Returns when nothing is left to prepare. For tests: it never returns while frames are active.
  void wait_until_done();

 private:
  // What the frames of a camera differ in.
  struct Moment {
    Pose pose;
    Vec3 sun;  // as Sun::direction
    bool operator==(const Moment& other) const;
  };
  static Moment moment_of(const FrameRequest& frame) { return {frame.pose, frame.sun.direction}; }
  static std::vector<Moment> moments_ahead(const FrameRequest& before, const FrameRequest& now,
                                           std::span<const Pose> ahead);
  // A prepared scene and the moment it is expected at.
  struct Ready {
    Moment moment;
    StillThere still_there;
  };
  // A camera and its expected course.
  struct Track {
    std::uint64_t number = 0;
    std::string name;
    FrameRequest last;
    std::uint64_t frame = 0;            // counts the frames that expected something
    StopToken::Clock::duration left{};  // of that frame's budget
    std::vector<Ready> ready{};
    const Ready* ready_for(const Moment& moment) const;  // null: none
  };
  struct Expected {
    std::uint64_t track = 0, frame = 0;
    std::size_t step = 0;  // 0: the camera's next frame
    FrameRequest request;
  };
  Track& track_of(const FrameRequest& frame, std::string_view name);
  Track* find_track(const Expected& next);  // null: a newer frame expects something else
  void forget_expected(std::uint64_t track);
  static void keep_ready(Track& track, std::span<const Moment> moments);
  void expect_at(Expected next);
  void run();
  enum class Outcome { done, given_up, out_of_budget };
  Outcome prepare(const Expected& next, StopToken::Clock::time_point deadline);
  void remember(const Expected& next, const StillThere& still_there);
  void try_again(const Expected& next);

  static constexpr std::size_t kMostTracks = 8;

  const Prepare prepare_;
  const StopToken::Clock::duration budget_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Track> tracks_;       // most recent first
  std::deque<Expected> expected_;  // ordered by step
  std::optional<Moment> current_;  // being prepared
  int in_work_ = 0;
  std::uint64_t next_track_ = 0;
  bool stopping_ = false;
  std::atomic<bool> give_up_{false};
  std::thread thread_;  // started with the first expectation
};

}  // namespace selenograph::engine
