// What a frame's products need to be known of each pixel: radiance, how much of the Sun its point sees, geometry.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "dem/detail/detail.h"
#include "dem/detail/rocks_on_ground.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

inline bool wants_radiance(const FrameRequest& request) { return request.products & (kRadiance | kImage); }
inline bool wants_light(const FrameRequest& request) { return wants_radiance(request) || (request.products & kLit); }
inline bool wants_geometry(const FrameRequest& request) { return request.products & kTruth; }

// Of a pixel's samples, how many are drawn at once (visibility/dense_samples.h): 4 by the z-buffer where there is an
// even number of them along a pixel's side. They take four times the memory, here that of the largest image which is
// served by default (16 million pixels); larger ones have one at a time. Edges are looked for among all four.
inline int drawn_at_once(const FrameRequest& request, const Accuracy& accuracy, Visibility visibility) {
  constexpr int kLargest_px = 2048;  // side
  if (!wants_radiance(request)) return 1;
  if (accuracy.edge_samples > 1 && !request.shutter) return accuracy.samples_per_pixel;
  const int side = static_cast<int>(std::lround(std::sqrt(accuracy.samples_per_pixel)));
  const bool fits = std::max(request.camera.width, request.camera.height) <= kLargest_px;
  return visibility != Visibility::raytrace && side % 2 == 0 && fits ? 4 : 1;
}

// Besides its products, of what a frame is rendered with: samples under the Sun and the shadow map's lists, twice as
// many of a disc, a lens's rays (of the pixels' centres and of a sample beside them), what a sensor's model has between
// radiance and digital numbers. An upper bound; scenes and terrain are not of it.
inline std::size_t working_bytes_per_pixel(const FrameRequest& request) {
  std::size_t bytes = 0;
  const auto at_once = static_cast<std::size_t>(drawn_at_once(request, request.accuracy, request.visibility));
  const bool dense = at_once > 1;
  if (wants_radiance(request)) bytes += (dense ? 12 : 8) * at_once;
  if (wants_light(request)) bytes += (request.sun.angular_radius_deg > 0 ? 96 : 48) * at_once;
  if (!request.camera.rectilinear()) bytes += dense ? 24 + 24 * (at_once + 1) : 48;
  // Edges: where they are, and samples under the Sun once more, of half the pixels at a time.
  if (wants_radiance(request) && request.accuracy.edge_samples > 1)
    bytes += (4 + (request.sun.angular_radius_deg > 0 ? 52 : 28) + (request.camera.rectilinear() ? 0 : 96)) * at_once;
  if (request.sensor && request.products & kImage) bytes += request.accuracy.samples_per_pixel > 1 ? 40 : 24;
  return bytes;
}

// The sensor's margin, which is not known before its kernel is, at its widest.
inline std::size_t rendered_pixels(const FrameRequest& request) {
  constexpr int kWidestMargin_px = 32;
  const int margin = request.sensor && request.products & kImage ? 2 * kWidestMargin_px : 0;
  return static_cast<std::size_t>(request.camera.width + margin) *
         static_cast<std::size_t>(request.camera.height + margin);
}

// The rows' views, where rows have views of their own (camera/row_views.h). An upper bound.
inline std::size_t bytes_of_rows(const Camera& camera, const std::optional<Shutter>& shutter) {
  constexpr std::size_t kBytesOfView = 1024;
  return shutter ? kBytesOfView * static_cast<std::size_t>(camera.height) : 0;
}

// The rocks of a detail that a frame or a batch of rays has at most, in places and shapes for Embree; those that are
// put onto the ground at once before it is known that they are too many; and those that rays remember from batch to
// batch, with them.
inline constexpr std::size_t kMostRocks = 32768, kMostNewRocks = 2 * kMostRocks,
                             kMostRememberedRocks = 100000 + kMostNewRocks;
inline std::size_t bytes_of_rocks(const dem::Detail* detail, std::size_t remembered = 0) {
  constexpr std::size_t kBytesOfRock = 2000;  // measured: 1600
  const bool any = detail && !detail->rocks().empty();
  if (!any) return 0;
  return kMostRocks * kBytesOfRock + dem::RockSurvey::kKeptBytes + remembered * sizeof(dem::RockFeature);
}

}  // namespace selenograph::engine
