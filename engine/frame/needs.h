// Derives from the requested products what must be computed for each pixel (radiance, light, geometry) and its memory.
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
inline bool wants_albedo(const FrameRequest& request) { return wants_radiance(request) || request.products & kAlbedo; }
inline bool wants_light_at_centres(const FrameRequest& request) { return request.products & (kLit | kIrradiance); }
inline bool wants_light(const FrameRequest& request) {
  return wants_radiance(request) || wants_light_at_centres(request);
}
inline bool wants_indirect(const FrameRequest& request) {
  return request.indirect.any() && request.terrain && (wants_radiance(request) || (request.products & kIrradiance));
}
inline bool wants_geometry(const FrameRequest& request) { return request.products & kTruth; }

// Returns true if points are also projected into a second image.
inline bool wants_flow(const FrameRequest& request) { return request.flow_to && (request.products & kFlow); }

// Returns the number of samples of a pixel that are drawn at once (visibility/image/dense_samples.h): 4 by the z-buffer
// if the number of samples along a pixel's side is even. Four samples take four times the memory, so this is limited to
// the largest image that is served by default (16 million pixels); larger images are drawn one sample at a time.
inline int drawn_at_once(const FrameRequest& request, const Accuracy& accuracy, Visibility visibility) {
  constexpr int kLargest_px = 2048;  // longest side
  if (!wants_radiance(request)) return 1;
  if (request.shutter) return 1;  // all samples of a pixel share its row's time
  const int side = static_cast<int>(std::lround(std::sqrt(accuracy.samples_per_pixel)));
  const bool fits = std::max(request.camera.width, request.camera.height) <= kLargest_px;
  return visibility != Visibility::raytrace && side % 2 == 0 && fits ? 4 : 1;
}

// Returns an upper bound of the working memory of a frame besides its products, scene and terrain: light-space samples
// and shadow-map lists (twice as many for a solar disc), rays of a lens (pixel centres and one sample offset), and the
// sensor's intermediate images.
inline std::size_t working_bytes_per_pixel(const FrameRequest& request) {
  std::size_t bytes = 0;
  const auto at_once = static_cast<std::size_t>(drawn_at_once(request, request.accuracy, request.visibility));
  const bool dense = at_once > 1;
  if (wants_radiance(request)) bytes += (dense ? 12 : 8) * at_once;
  if (wants_light(request)) bytes += (request.sun.angular_radius_deg > 0 ? 96 : 48) * at_once;
  if (!request.camera.rectilinear()) bytes += dense ? 24 + 24 * (at_once + 1) : 48;
  if (request.sensor && request.products & kImage) {
    bytes += request.accuracy.samples_per_pixel > 1 ? 40 : 24;
    if (request.sensor->optics.stray_light.any()) bytes += 80;  // frequencies of an image with four times the pixels
  }
  return bytes;
}

// Returns the pixels of an image with the sensor's margin at its maximum: the margin is unknown until the kernel has
// been computed.
inline std::size_t rendered_pixels(const FrameRequest& request) {
  constexpr int kWidestMargin_px = 33;
  const int margin = request.sensor && request.products & kImage ? 2 * kWidestMargin_px : 0;
  return static_cast<std::size_t>(request.camera.width + margin) *
         static_cast<std::size_t>(request.camera.height + margin);
}

// Returns an upper bound of the memory for views of rows (camera/row_views.h).
inline std::size_t bytes_of_rows(const Camera& camera, const std::optional<Shutter>& shutter) {
  constexpr std::size_t kBytesOfView = 1024;
  return shutter ? kBytesOfView * static_cast<std::size_t>(camera.height) : 0;
}

// Limits of a detail's rocks: placed shapes for Embree per frame; those with soil against them, each with its own
// shape; rocks per batch of rays, all with soil; rocks per search, before their number is known; rocks cached from
// batch to batch of rays.
inline constexpr std::size_t kMaxRocks = 32768;
inline constexpr std::size_t kMaxRocksWithSoil = kMaxRocks / 4;
inline constexpr std::size_t kMaxRocksOfRays = kMaxRocks / 2;
inline constexpr std::size_t kMaxNewRocks = 2 * kMaxRocks;
inline constexpr std::size_t kMaxCachedRocks = 100000 + kMaxNewRocks;
inline std::size_t bytes_of_rocks(const dem::Detail* detail, std::size_t cached_rocks = 0) {
  constexpr std::size_t kBytesOfRock = 2000;  // measured: 1600, and as much again for the quarter with soil
  const bool any = detail && !detail->rocks().empty();
  if (!any) return 0;
  return kMaxRocks * kBytesOfRock + dem::RockSurvey::kKeptBytes + cached_rocks * sizeof(dem::RockFeature);
}

// Returns true if craters are listed, which requires detail and terrain.
inline bool wants_craters(const FrameRequest& request) { return request.craters && request.detail && request.terrain; }

// Returns true if the Sun's or the Earth's disc is shown.
inline bool wants_discs(const FrameRequest& request) {
  return request.sky && (request.sky->sun || request.sky->earth) && wants_radiance(request);
}
// Returns true if only pixels tell which sky the ground hides. A ray along the horizon of ground with detail would need
// so many of the finest blocks that it takes seconds.
inline bool hides_by_pixels(const FrameRequest& request) { return request.detail && request.terrain; }
inline bool wants_points(const FrameRequest& request) {
  return request.sky && (request.sky->stars || request.sky->planets) && wants_radiance(request);
}
inline bool wants_ranges_for_sky(const FrameRequest& request) {
  return wants_discs(request) || (wants_points(request) && hides_by_pixels(request));
}
// Returns true if each pixel's range must be drawn, for craters or for hiding the sky, whatever products are requested.
inline bool wants_ranges(const FrameRequest& request) {
  return wants_craters(request) || wants_ranges_for_sky(request);
}
// Returns the products of a frame that is drawn for its radiance.
inline ProductSet for_radiance(const FrameRequest& request) {
  return wants_ranges_for_sky(request) ? ProductSet{kRadiance | kRange} : ProductSet{kRadiance};
}

// Limit of craters that a frame lists, and the memory of that list with its text.
inline constexpr std::size_t kMaxCraters = 100000;
inline std::size_t bytes_of_craters(const FrameRequest& request) {
  constexpr double kBytesOfCrater = 8000;
  if (!wants_craters(request)) return 0;
  // Number of craters larger than D per square of side D. An image shows those of at least least_px, and as many again
  // at a slant.
  const dem::CraterLaw& law = request.detail->craters().law();
  double densest = 0;
  for (int octave = 0; std::ldexp(law.smallest_m, octave) < law.largest_m; ++octave) {
    const double d_m = std::ldexp(law.smallest_m, octave);
    densest = std::max(densest, law.frequency.above(d_m) * d_m * d_m);
  }
  const double pixels = static_cast<double>(request.camera.width) * request.camera.height,
               number = 2 * densest * pixels / (request.craters->least_px * request.craters->least_px);
  return static_cast<std::size_t>(kBytesOfCrater * std::min(number, static_cast<double>(kMaxCraters)));
}

}  // namespace selenograph::engine
