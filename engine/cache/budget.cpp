#include "engine/cache/budget.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dem/base/error.h"
#include "engine/frame/needs.h"

namespace selenograph::engine {
namespace {

// Before anything is known: a core of a server of 2024. Wrong by a factor of a few elsewhere, for a few frames.
constexpr double kMsPerFrame = 2, kMsPerRay = 6e-6, kMsPerTriangle = 40e-6;

double ray_units(const FrameWork& work) { return work.rays * std::log2(2 + work.triangles); }

// Moves an eighth of the way toward what was measured, which counts as at most four times off: one frame that waited
// for the disk changes the estimate by less than 3/8, and eight frames of another speed by two thirds of the
// difference. `share`: of what was predicted, this value's; what was wrong is blamed on each by its share.
void approach(std::atomic<double>& value, double measured_to_predicted, double share) {
  const double old = value.load(std::memory_order_relaxed);
  value.store(old * (1 + share * (std::clamp(measured_to_predicted, 0.25, 4.0) - 1) / 8), std::memory_order_relaxed);
}

}  // namespace

FrameWork work_of(const FrameRequest& request, const Accuracy& accuracy, Visibility visibility, double triangles,
                  bool build) {
  const double pixels = static_cast<double>(request.camera.width) * request.camera.height;
  const bool centres_too = accuracy.samples_per_pixel > 1 && wants_geometry(request);
  // Four drawn at once take twice a frame's time, or a little more.
  constexpr double kOfFourAtOnce = 0.55;
  const bool at_once = visibility == Visibility::zbuffer && drawn_at_once(request, accuracy, visibility) > 1;
  // Edges take as long again as what they are edges of.
  const double at_edges = accuracy.edge_samples > 1 ? 2 : 1;
  const double samples = !wants_radiance(request)
                             ? 1
                             : accuracy.samples_per_pixel * at_edges * (at_once ? kOfFourAtOnce : 1) + centres_too;
  // Of a disc, horizons cost about as much again as the shadow map. By rays nine directions are asked for, and 256 in
  // the penumbra, which is a tenth of the frame or so.
  constexpr double kByHorizons = 2, kByRays = 35;
  const double of_disc = visibility == Visibility::zbuffer ? kByHorizons : kByRays;
  const double per_sample = 1 + (!wants_light(request) ? 0 : request.sun.angular_radius_deg > 0 ? of_disc : 1);
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
                 rays = ray_units(work) * ms_per_ray_.load(std::memory_order_relaxed), predicted = frame + rays;
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
  for (std::atomic<double>* value : {&ms_per_ray_, &ms_per_triangle_})
    value->store(value->load(std::memory_order_relaxed) * 7 / 8, std::memory_order_relaxed);
  throw TooMuchWork(fmt::format("expected to take about {:.0f} s; {}", ms / 1e3, remedy), ms);
}

double expected_error(const Accuracy& accuracy) {
  // Fitted by eye to the sample terrain's nadir and descent: of coarse terrain slopes are missing, of fine terrain one
  // sample picks single slopes out of many.
  const double error_px = std::max(accuracy.max_error_px, 1.0 / 64);  // 0 asks for the finest: not to divide by it
  const double smooth = 0.034 * error_px;
  const double one_sample = 0.03 * std::pow(0.5 / error_px, 0.7);
  return std::hypot(smooth, one_sample / accuracy.samples_per_pixel);
}

}  // namespace selenograph::engine
