// Prepares scenes of expected frames in idle time. Each frame has a budget of time, all share one of memory
// (RenderCache). It never changes a byte of any answer.
//
//   frame --> expect() --> Track of its camera --> poses ahead --> queue, soonest step first
//                                                                        |
//   Work (a request is rendered): pauses the thread, cancels its scene   v
//                                                   preparation thread: prepare_() --> scene in RenderCache
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
  // Returns whether the prepared scene is still cached, and marks it as used in the cache's LRU order.
  using IsStillCached = std::function<bool()>;
  // Makes the scene of a frame; throws Cancelled when stopped. Other exceptions are ignored: the frame itself will
  // report them.
  using Prepare = std::function<IsStillCached(const FrameRequest&, const StopToken&)>;
  // `budget`: time for all scenes that one frame expects, retries included.
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

  // Queues the scenes of the frames expected after `frame`. `ahead`: the camera's next poses, soonest first. The Sun's
  // motion since its previous frame is extrapolated. Replaces earlier expectations for this camera. `name`
  // distinguishes identical cameras.
  void expect(const FrameRequest& frame, std::span<const Pose> ahead, std::string_view name = {});

  // Returns when nothing is left to prepare. For tests: it never returns while frames are active.
  void wait_until_done();

 private:
  // The parts of a request that change from frame to frame of one camera.
  struct PoseAndSun {
    Pose pose;
    Vec3 sun;  // as Sun::direction
    bool operator==(const PoseAndSun& other) const;
  };
  static PoseAndSun pose_and_sun_of(const FrameRequest& frame) { return {frame.pose, frame.sun.direction}; }
  // Returns the poses `ahead`, each with the Sun a step farther.
  static std::vector<PoseAndSun> upcoming_states(const Vec3& sun_before, const Vec3& sun, std::span<const Pose> ahead);
  // A prepared scene and the frame that it is for.
  struct Prepared {
    PoseAndSun state;
    IsStillCached is_still_cached;
  };
  // A moving camera: its last frame and the scenes prepared for its next ones.
  struct Track {
    std::uint64_t number = 0;
    std::string name;
    FrameRequest last;
    std::uint64_t frame = 0;                   // number of calls of expect()
    StopToken::Clock::duration budget_left{};  // for the scenes that the last frame expects
    std::vector<Prepared> prepared{};
    const Prepared* find_prepared(const PoseAndSun& state) const;  // null: none
  };
  // An entry of the queue. `track` and `frame` are Track::number and Track::frame at the time of expect().
  struct Expected {
    std::uint64_t track = 0, frame = 0;
    std::size_t step = 0;  // 0: the camera's next frame
    FrameRequest request;
  };
  // Returns the track that a frame continues, or a new one; either becomes the most recent.
  Track& track_of(const FrameRequest& frame, std::string_view name);
  Track* find_track(const Expected& next);  // null if a newer frame of the camera has replaced the expectation
  void forget_expected(std::uint64_t track);
  static void drop_stale(Track& track, std::span<const PoseAndSun> upcoming);
  void enqueue(Expected next);
  void run();  // the preparation thread
  enum class Outcome { done, cancelled, out_of_budget };
  Outcome prepare(const Expected& next, StopToken::Clock::time_point deadline);
  void record_prepared(const Expected& next, const IsStillCached& is_still_cached);
  void requeue(const Expected& next);

  static constexpr std::size_t kMaxTracks = 8;

  const Prepare prepare_;
  const StopToken::Clock::duration budget_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Track> tracks_;           // most recent first
  std::deque<Expected> expected_;      // queue, ordered by step
  std::optional<PoseAndSun> current_;  // frame whose scene is being prepared
  int active_work_ = 0;                // number of Work objects
  std::uint64_t next_track_ = 0;
  bool stopping_ = false;
  std::atomic<bool> cancel_{false};  // cancels the scene being prepared
  std::thread thread_;               // started with the first expectation
};

}  // namespace selenograph::engine
