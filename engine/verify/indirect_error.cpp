#include "engine/verify/indirect_error.h"

#include <algorithm>
#include <cmath>
#include <ctime>
#include <numbers>

#include "dem/base/quantile.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/photometry.h"
#include "engine/rays/ray_queries.h"

namespace selenograph::engine {
namespace {

constexpr int kPointsAlong = 12;

std::vector<RayHit> cast(std::span<const Ray> rays, const Renderer& renderer, const Sun& sun) {
  return renderer.query({}, {}, [&](const RenderContext& context) { return cast_rays(rays, {}, sun, context); });
}

// Returns the ground at a position as rays hit it: it may be finer than a frame's ground, and above it.
Vec3 on_ground(const Renderer& renderer, const Vec3& position_m, const FrameRequest& request) {
  constexpr double kAbove_m = 1000;
  const Vec3 up = position_m.normalized();
  const Ray down{position_m + kAbove_m * up, -up};
  const RayHit hit = cast({&down, 1}, renderer, request.sun).front();
  return hit.hit ? hit.position_m : position_m;
}

// Returns the light that a point receives from the ground around it, W m-2, by rays over the sphere of directions.
double light_by_rays(const Renderer& renderer, const Vec3& position_m, const Vec3& normal, const FrameRequest& request,
                     int strata) {
  constexpr int kDirections = 128, kHigh = 8;
  constexpr double kBorder = 0.4, kPi = std::numbers::pi;
  // Lower bound of a low stratum's elevations, which are denser towards the horizon.
  const auto low = [&](double row) {
    const double u = 2 * row / strata - 1;
    return kBorder * u * (0.15 + 0.85 * u * u);
  };
  const EastNorthUp axes = local_axes(position_m.normalized());
  std::vector<Ray> rays;
  std::vector<double> weights;
  // Order rays by azimuth: neighbouring rays hit the same terrain.
  for (int k = 0; k < kDirections; ++k)
    for (int row = 0; row < strata + kHigh; ++row) {
      const bool is_low = row < strata;
      const double height = is_low ? low(row + 1) - low(row) : (kPi / 2 - kBorder) / kHigh,
                   elevation = is_low ? low(row + 0.5) : kBorder + (row - strata + 0.5) * height;
      const double phi = 2 * kPi * (k + 0.25 + 0.5 * (row % 2)) / kDirections;
      const Vec3 direction = std::cos(elevation) * (std::cos(phi) * axes.east + std::sin(phi) * axes.north) +
                             std::sin(elevation) * axes.up;
      const double cosine = direction.dot(normal);
      if (cosine <= 0) continue;
      rays.push_back({position_m + 1e-3 * axes.up, direction});
      weights.push_back(cosine * std::cos(elevation) * height * 2 * kPi / kDirections);
    }
  const std::vector<RayHit> hits = cast(rays, renderer, request.sun);
  const Brdf brdf(request.reflectance, band_of(request));
  double sum = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    // Ignore hits on the point's own facet: directions above the interpolated normal's plane may be below the facet's.
    if (!hits[i].hit || hits[i].range_m < 2) continue;
    const double mu0 = hits[i].normal.dot(request.sun.direction);
    if (!(mu0 > 0 && hits[i].lit > 0)) continue;
    const Vec3 back = -rays[i].direction;
    sum += weights[i] * hits[i].lit *
           brdf.times_mu0(mu0, std::max(hits[i].normal.dot(back), 0.0), back.dot(request.sun.direction));
  }
  return kSolarConstant_w_m2 * sum;
}

// Returns the processor time of a frame. Unlike elapsed time it does not grow with the machine's other work.
double ms_of(const Renderer& renderer, const FrameRequest& request) {
  const std::clock_t start = std::clock();
  renderer.render(request);
  return 1e3 * static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
}

// Returns the request under a Sun three degrees further along its great circle around the zenith.
FrameRequest with_next_sun(FrameRequest request) {
  constexpr double kStep_deg = 3;
  request.sun.direction =
      Eigen::AngleAxisd(kStep_deg * kRadiansPerDegree, request.pose.position_m.normalized()) * request.sun.direction;
  return request;
}

}  // namespace

IndirectTruth::IndirectTruth(const Renderer& renderer, const FrameRequest& request, int strata) : request_(request) {
  request_.products = kPosition | kNormal | kLit;
  const FrameProducts products = renderer.render(request_).products;
  const auto at = [](const auto& values, std::size_t i) {
    return Vec3(double(values[3 * i]), double(values[3 * i + 1]), double(values[3 * i + 2]));
  };
  const int side = request.camera.width, step = side / kPointsAlong;
  for (int row = step / 3; row < side; row += step)
    for (int column = step / 3; column < side; column += step) {
      const auto pixel = static_cast<std::size_t>(row * side + column);
      const Vec3 position_m = at(products.position, pixel);
      if (std::isnan(position_m.x())) continue;
      pixels_.push_back(pixel);
      in_shadow_.push_back(products.lit[pixel] == 0);
      light_w_m2_.push_back(light_by_rays(renderer, on_ground(renderer, position_m, request),
                                          at(products.normal, pixel), request, strata));
    }
  request_.products = kIrradiance;
  request_.indirect.terrain = true;
}

IndirectTruth::Error IndirectTruth::of(const std::vector<float>& irradiance) const {
  Error out;
  double ours = 0, truths = 0, squares = 0, shadow_ours = 0, shadow_truths = 0, shadow_squares = 0;
  int shadows = 0;
  std::vector<double> differences;
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const double light = static_cast<double>(irradiance[3 * pixels_[i] + 1]), truth = light_w_m2_[i];
    if (std::isnan(light)) continue;
    ours += light;
    truths += truth;
    squares += std::pow(light - truth, 2);
    if (in_shadow_[i]) {
      shadow_ours += light;
      shadow_truths += truth;
      shadow_squares += std::pow(light - truth, 2);
      ++shadows;
    }
    differences.push_back(truth > 0 ? std::abs(light / truth - 1) : 0);
    if (truth > 1e-4 * kSolarConstant_w_m2) out.worst = std::max(out.worst, differences.back());
    ++out.places;
  }
  if (out.places == 0 || !(truths > 0)) return out;
  out.median = median(differences);
  out.ratio = ours / truths;
  if (shadow_truths > 0) {
    out.shadow_ratio = shadow_ours / shadow_truths;
    out.shadow_rms = std::sqrt(shadow_squares / shadows) / (shadow_truths / shadows);
  }
  out.rms = std::sqrt(squares / out.places) / (truths / out.places);
  return out;
}

IndirectRow measure_indirect(const Renderer& renderer, const IndirectTruth& truth, double spacing_px, int repetitions) {
  FrameRequest with = truth.request();
  with.indirect.spacing_px = spacing_px;
  FrameRequest without = with;
  without.indirect.terrain = false;
  IndirectRow row;
  row.spacing_px = spacing_px;
  renderer.render(without);
  row.first_ms = ms_of(renderer, with);
  row.error = truth.of(renderer.render(with).products.irradiance);
  row.new_sun_ms = ms_of(renderer, with_next_sun(with));
  std::vector<double> cached_ms, without_ms;
  for (int i = 0; i < repetitions; ++i) {
    without_ms.push_back(ms_of(renderer, without));
    cached_ms.push_back(ms_of(renderer, with));
  }
  row.without_ms = *std::min_element(without_ms.begin(), without_ms.end());
  row.kept_ms = *std::min_element(cached_ms.begin(), cached_ms.end());
  return row;
}

}  // namespace selenograph::engine
