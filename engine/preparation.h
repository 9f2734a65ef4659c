// What the next frames need, made before they are asked for: in idle time, on the budgets, and never for a byte's
// difference in any answer.
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

#include "dem/support/stop_token.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Of scenes that were made in preparation: how many, how many of them a frame has had, and how many went without.
struct PreparationStatistics {
  std::uint64_t prepared = 0, used = 0, wasted = 0;
};

// Safe to use concurrently.
class Preparation {
 public:
  // Whether what was made is still there; then it has been used just now.
  using StillThere = std::function<bool()>;
  // Makes what a frame needs; gives up (Cancelled) when it is told to. What else it throws is the frame's own matter.
  using Prepare = std::function<StillThere(const FrameRequest&, const StopToken&)>;
  explicit Preparation(Prepare prepare);
  ~Preparation();
  Preparation(const Preparation&) = delete;
  Preparation& operator=(const Preparation&) = delete;

  // Something in work: while there is any nothing is prepared, and what was begun is given up, unless it is for this
  // very frame. `pose` is a frame's; null: it is no frame.
  class Work {
   public:
    Work(Preparation& preparation, const Pose* pose);
    ~Work();
    Work(const Work&) = delete;
    Work& operator=(const Work&) = delete;

   private:
    Preparation& preparation_;
  };

  // After a frame: where its camera is expected next, soonest first. Of none, the camera is taken to go on as it did
  // from the frame before. Replaces what was expected of this camera. `name`: tells cameras apart that are alike.
  void expect(const FrameRequest& frame, std::span<const Pose> ahead, std::string_view name = {});

  // Returns when nothing is left to prepare. For tests: with frames in work it never does.
  void wait_until_done();

 private:
  // What was prepared, for a pose that a client is expected to ask for.
  struct Ready {
    Pose pose;
    StillThere still_there;
  };
  // A camera on its way.
  struct Track {
    std::uint64_t number = 0;
    std::string name;
    FrameRequest last;
    std::vector<Ready> ready{};
    const Ready* ready_for(const Pose& pose) const;  // null: none is
  };
  struct Expected {
    std::uint64_t track = 0;
    std::size_t step = 0;  // 0: its camera's next
    FrameRequest request;
  };
  Track& track_of(const FrameRequest& frame, std::string_view name);
  static void keep_ready(Track& track, std::span<const Pose> poses);
  void expect_at(Expected next);
  void run();
  bool prepared(const Expected& next);
  void remember(const Expected& next, const StillThere& still_there);
  void try_again(const Expected& next);

  static constexpr std::size_t kMostTracks = 8;

  const Prepare prepare_;
  std::mutex mutex_;
  std::condition_variable changed_;
  std::deque<Track> tracks_;       // first the latest
  std::deque<Expected> expected_;  // by steps
  std::optional<Pose> current_;    // being prepared
  int in_work_ = 0;
  std::uint64_t next_track_ = 0;
  bool stopping_ = false;
  std::atomic<bool> give_up_{false};
  std::thread thread_;  // from the first expectation on
};

}  // namespace selenograph::engine
