// Chooses accuracy settings for a time budget: `"accuracy": {"budget_ms": N}`.
//
// The time of a frame is predicted from its rays, its triangles and the measured speed of this process; its error from
// what `selenograph verify accuracy` measures. The choice therefore depends on the machine and its load. The report
// names the chosen setting; requested by its numbers, that setting gives the same bytes.
#pragma once

#include <array>
#include <atomic>
#include <optional>
#include <string_view>

#include "dem/base/stop_token.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

struct BudgetChoice {
  Accuracy accuracy;
  double predicted_ms = 0;
  bool fits = false;  // false: even the coarsest setting is predicted to take longer
};
// Replaces the choice by `next` if there is none yet, or if `next` fits and has a smaller expected error.
void prefer(std::optional<BudgetChoice>& best, const BudgetChoice& next);

// Work of a frame, from which its time is predicted.
struct FrameWork {
  double rays = 0;  // primary and shadow rays of all samples, or the cost of what replaces them
  double triangles = 0;
  bool build = false;  // its acceleration structure must be built
};
// Returns the work of a frame. `triangles`, `build`: copied into the result.
FrameWork work_of(const FrameRequest& request, const Accuracy& accuracy, Visibility visibility, double triangles,
                  bool build);

// Learns the cost per ray, per triangle and per frame from each rendered frame. Thread-safe without a lock: of two
// concurrent updates one may be lost, and one frame is not learnt from.
class SpeedGauge {
 public:
  explicit SpeedGauge(int threads);
  double predicted_ms(const FrameWork& work) const;
  void learn(const FrameWork& work, const StageTimes& times);
  // Throws TooMuchWork when the work, done `times` times, is predicted to take much longer than `stop` allows. A
  // prediction may be wrong by a factor of kDoubt, and work of less than kAlwaysTried_ms is always tried. A refusal
  // measures nothing, so each refusal lowers the estimate it was based on: a wrong estimate recovers. `remedy`: advice
  // for the error message, in the words of the request.
  void refuse_hopeless(const FrameWork& work, std::size_t times, std::string_view remedy, const StopToken& stop);
  static constexpr double kDoubt = 4, kAlwaysTried_ms = 1000;
  static bool in_reach(double predicted_ms, double allowed_ms) {
    return predicted_ms <= kDoubt * allowed_ms + kAlwaysTried_ms;
  }

 private:
  // Milliseconds per frame, per ray and doubling of the triangle count, and per triangle built.
  std::atomic<double> ms_per_frame_, ms_per_ray_, ms_per_triangle_;
};

// Candidate levels of detail and samples per pixel; each is finer than the one before.
inline constexpr std::array<double, 6> kBudgetErrors_px{4, 2, 1, 0.5, 0.25, 0.125};
inline constexpr std::array<int, 3> kBudgetSamples{1, 4, 16};

// Expected RMS radiance error, relative to the sunlit mean. It has two parts: terrain that is too smooth, and pixels
// that are sampled at points instead of averaged. With one sample per pixel, terrain finer than about the default only
// aliases more.
double expected_error(const Accuracy& accuracy);

}  // namespace selenograph::engine
