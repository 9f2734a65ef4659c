// Which setting a time budget allows: `"accuracy": {"budget_ms": N}`.
//
// How long a frame takes is predicted from its rays and triangles and from how fast this process has been so far; how
// true it will be, from what `selenograph verify accuracy` measures. So the choice depends on the machine and its load:
// what was chosen is reported, and asked for by its numbers it gives the same bytes.
#pragma once

#include <array>
#include <atomic>

#include "dem/support/stop_token.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

struct BudgetChoice {
  Accuracy accuracy;
  double predicted_ms = 0;
  bool fits = false;  // false: even the coarsest setting is predicted to take longer
};

// What a frame will cost.
struct FrameWork {
  double rays = 0;  // of all samples, shadow rays counted as one more
  double triangles = 0;
  bool build = false;  // its acceleration structure is yet to be made
};
FrameWork work_of(const FrameRequest& request, const Accuracy& accuracy, Visibility visibility, double triangles,
                  bool build);

// Learns from each frame what rays and triangles cost, and what any frame does. Safe to use concurrently: a lost update
// is a frame not learnt from.
class SpeedGauge {
 public:
  explicit SpeedGauge(int threads);
  double predicted_ms(const FrameWork& work) const;
  void learn(const FrameWork& work, const StageTimes& times);
  // Throws TooMuchWork when the work, `times` over, is predicted to take much longer than `stop` allows. A prediction
  // may be off by a factor of kDoubt, and what takes moments is always tried. A refusal measures nothing: what it
  // follows from is believed less afterwards, so that an estimate that went wrong mends.
  void refuse_hopeless(const FrameWork& work, std::size_t times, const StopToken& stop);
  static constexpr double kDoubt = 4, kMoments_ms = 1000;
  static bool in_reach(double predicted_ms, double allowed_ms) {
    return predicted_ms <= kDoubt * allowed_ms + kMoments_ms;
  }

 private:
  // Milliseconds per frame, per ray and doubling of the triangles, and per triangle built.
  std::atomic<double> ms_per_frame_, ms_per_ray_, ms_per_triangle_;
};

// The levels of detail and samples that are chosen from; each finer than the one before.
inline constexpr std::array<double, 6> kBudgetErrors_px{4, 2, 1, 0.5, 0.25, 0.125};
inline constexpr std::array<int, 3> kBudgetSamples{1, 4, 16};

// RMS radiance error to expect, relative to the sunlit mean: terrain too smooth, and pixels that are points where they
// should be areas. With one sample per pixel terrain finer than about the default only aliases more.
double expected_error(const Accuracy& accuracy);

}  // namespace selenograph::engine
