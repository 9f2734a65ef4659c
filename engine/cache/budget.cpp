#include "engine/cache/budget.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dem/base/error.h"
#include "engine/frame/needs.h"

namespace selenograph::engine {
namespace {

// Initial estimates, for one core of a server of 2024. On other machines they are wrong by a small factor until a few
// frames have been measured.
constexpr double kMsPerFrame = 2, kMsPerRay = 6e-6, kMsPerTriangle = 40e-6;

// Returns the cost of rays in units of one ray per doubling of the triangle count: the depth of the tree.
double ray_units(const FrameWork& work) { return work.rays * std::log2(2 + work.triangles); }

// Moves an estimate an eighth of the way toward a measurement. The ratio is clamped to 1/4..4: one frame that waited
// for the disk changes the estimate by at most 3/8, and eight frames of a different speed close two thirds of the
// difference. `share`: this estimate's share of the prediction; the error is attributed to each estimate by its share.
void approach(std::atomic<double>& value, double measured_to_predicted, double share) {
  const double old = value.load(std::memory_order_relaxed);
  value.store(old * (1 + share * (std::clamp(measured_to_predicted, 0.25, 4.0) - 1) / 8), std::memory_order_relaxed);
}

}  // namespace

void prefer(std::optional<BudgetChoice>& best, const BudgetChoice& next) {
  if (!best || (next.fits && expected_error(next.accuracy) < expected_error(best->accuracy))) best = next;
}

FrameWork work_of(const FrameRequest& request, const Accuracy& accuracy, Visibility visibility, double triangles,
                  bool build) {
  const double pixels = static_cast<double>(request.camera.width) * request.camera.height;
  // With several samples, geometry takes one more ray, through the pixel's centre.
  const double centre_rays = accuracy.samples_per_pixel > 1 && wants_geometry(request) ? 1 : 0;
  // Cost per sample when the z-buffer draws several at once: four take a little more than twice the time of one.
  constexpr double kPerSampleAtOnce = 0.55;
  const bool at_once = visibility == Visibility::zbuffer && drawn_at_once(request, accuracy, visibility) > 1;
  const double samples =
      !wants_radiance(request) ? 1 : accuracy.samples_per_pixel * (at_once ? kPerSampleAtOnce : 1) + centre_rays;
  // Shadow rays per sample of an extended Sun. For the z-buffer, the shadow map and horizons, which cost as much. Ray
  // tracing casts nine rays to the disc, and 256 in the penumbra, which covers about a tenth of a frame.
  constexpr double kByHorizons = 2, kByRays = 35;
  const double disc_rays = visibility == Visibility::zbuffer ? kByHorizons : kByRays;
  const double sun_rays = request.sun.angular_radius_deg > 0 ? disc_rays : 1;
  const double per_sample = 1 + (wants_light(request) ? sun_rays : 0);
  return {pixels * samples * per_sample, triangles, build};
}

SpeedGauge::SpeedGauge(int threads)
    : ms_per_frame_(kMsPerFrame), ms_per_ray_(kMsPerRay / threads), ms_per_triangle_(kMsPerTriangle / threads) {}

double SpeedGauge::predicted_ms(const FrameWork& work) const {
  return ms_per_frame_.load(std::memory_order_relaxed) + ray_units(work) * ms_per_ray_.load(std::memory_order_relaxed) +
         (work.build ? work.triangles * ms_per_triangle_.load(std::memory_order_relaxed) : 0);
}

void SpeedGauge::learn(const FrameWork& work, const StageTimes& times) {
  if (work.rays > 0) {
    const double frame = ms_per_frame_.load(std::memory_order_relaxed),
                 rays = ray_units(work) * ms_per_ray_.load(std::memory_order_relaxed);
    const double predicted = frame + rays;
    approach(ms_per_frame_, times.visibility_ms / predicted, frame / predicted);
    approach(ms_per_ray_, times.visibility_ms / predicted, rays / predicted);
  }
  if (work.build && work.triangles > 0) {
    const double predicted = work.triangles * ms_per_triangle_.load(std::memory_order_relaxed);
    approach(ms_per_triangle_, times.build_ms / predicted, 1);
  }
}

void SpeedGauge::refuse_hopeless(const FrameWork& work, std::size_t times, std::string_view remedy,
                                 const StopToken& stop) {
  const double ms = predicted_ms(work) * static_cast<double>(times);
  if (in_reach(ms, stop.remaining_ms())) return;
  // A refused frame measures nothing: lower the estimates, so that one that became too high does not refuse for ever.
  for (std::atomic<double>* value : {&ms_per_ray_, &ms_per_triangle_})
    value->store(value->load(std::memory_order_relaxed) * 7 / 8, std::memory_order_relaxed);
  throw TooMuchWork(fmt::format("expected to take about {:.0f} s; {}", ms / 1e3, remedy), ms);
}

double expected_error(const Accuracy& accuracy) {
  // Fitted by eye to frames of the sample terrain, nadir and descent. Coarse terrain lacks slopes; on fine terrain one
  // sample per pixel picks a single slope out of many.
  const double error_px = std::max(accuracy.max_error_px, 1.0 / 64);  // avoids division by 0, the finest setting
  const double smooth = 0.034 * error_px;
  const double one_sample = 0.03 * std::pow(0.5 / error_px, 0.7);
  return std::hypot(smooth, one_sample / accuracy.samples_per_pixel);
}

}  // namespace selenograph::engine
