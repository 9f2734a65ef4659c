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

// Replaces positions by the ground there as rays hit it: it may be finer than a frame's ground, and above it.
void put_on_ground(std::vector<Vec3>& positions_m, const Renderer& renderer, const FrameRequest& request) {
  constexpr double kAbove_m = 1000;
  std::vector<Ray> down;
  for (const Vec3& position_m : positions_m) {
    const Vec3 up = position_m.normalized();
    down.push_back({position_m + kAbove_m * up, -up});
  }
  const std::vector<RayHit> hits = cast(down, renderer, request.sun);
  for (std::size_t i = 0; i < hits.size(); ++i)
    if (hits[i].hit) positions_m[i] = hits[i].position_m;
}

// Rays over the sphere of directions, and each one's share of its point's irradiance at unit radiance.
struct SphereRays {
  std::vector<Ray> rays;
  std::vector<double> weights;
  std::vector<std::size_t> points;
};

constexpr int kAzimuths = 128;

// Appends a point's rays of one azimuth.
void add_azimuth(int azimuth, std::size_t point, const Vec3& position_m, const Vec3& normal, int strata,
                 SphereRays& out) {
  constexpr int kHigh = 8;
  constexpr double kBorder = 0.4, kPi = std::numbers::pi;
  // Lower bound of a low stratum's elevations, which are denser towards the horizon.
  const auto low = [&](double row) {
    const double u = 2 * row / strata - 1;
    return kBorder * u * (0.15 + 0.85 * u * u);
  };
  const EastNorthUp axes = local_axes(position_m.normalized());
  for (int row = 0; row < strata + kHigh; ++row) {
    const bool is_low = row < strata;
    const double height = is_low ? low(row + 1) - low(row) : (kPi / 2 - kBorder) / kHigh,
                 elevation = is_low ? low(row + 0.5) : kBorder + (row - strata + 0.5) * height;
    const double phi = 2 * kPi * (azimuth + 0.25 + 0.5 * (row % 2)) / kAzimuths;
    const Vec3 direction =
        std::cos(elevation) * (std::cos(phi) * axes.east + std::sin(phi) * axes.north) + std::sin(elevation) * axes.up;
    const double cosine = direction.dot(normal);
    if (cosine <= 0) continue;
    out.rays.push_back({position_m + 1e-3 * axes.up, direction});
    out.weights.push_back(cosine * std::cos(elevation) * height * 2 * kPi / kAzimuths);
    out.points.push_back(point);
  }
}

// Adds the light that the rays bring to their points, W m-2.
void add_light(const SphereRays& from, const Renderer& renderer, const FrameRequest& request,
               std::vector<double>& light_w_m2) {
  const std::vector<RayHit> hits = cast(from.rays, renderer, request.sun);
  const Brdf brdf(request.reflectance, band_of(request));
  for (std::size_t i = 0; i < hits.size(); ++i) {
    // Ignore hits on the point's own facet: directions above the interpolated normal's plane may be below the facet's.
    if (!hits[i].hit || hits[i].range_m < 2) continue;
    const double mu0 = hits[i].normal.dot(request.sun.direction);
    if (!(mu0 > 0 && hits[i].lit > 0)) continue;
    const Vec3 back = -from.rays[i].direction;
    light_w_m2[from.points[i]] +=
        kSolarConstant_w_m2 * from.weights[i] * hits[i].lit *
        brdf.times_mu0(mu0, std::max(hits[i].normal.dot(back), 0.0), back.dot(request.sun.direction));
  }
}

// Returns the light that points receive from the ground around them, W m-2, by rays over the sphere of directions.
// Casts all points' rays of an azimuth together: they hit the same terrain, whose acceleration structure each cast
// builds anew.
std::vector<double> light_by_rays(const Renderer& renderer, const std::vector<Vec3>& positions_m,
                                  const std::vector<Vec3>& normals, const FrameRequest& request, int strata) {
  constexpr std::size_t kMaxRays = 1 << 19;  // some 200 MB with their hits
  std::vector<double> light_w_m2(positions_m.size(), 0);
  SphereRays from;
  for (int azimuth = 0; azimuth < kAzimuths; ++azimuth) {
    for (std::size_t i = 0; i < positions_m.size(); ++i)
      add_azimuth(azimuth, i, positions_m[i], normals[i], strata, from);
    if (from.rays.size() < kMaxRays && azimuth + 1 < kAzimuths) continue;
    add_light(from, renderer, request, light_w_m2);
    from = {};
  }
  return light_w_m2;
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
  std::vector<Vec3> positions_m, normals;
  const int side = request.camera.width, step = side / kPointsAlong;
  for (int row = step / 3; row < side; row += step)
    for (int column = step / 3; column < side; column += step) {
      const auto pixel = static_cast<std::size_t>(row * side + column);
      const Vec3 position_m = at(products.position, pixel);
      if (std::isnan(position_m.x())) continue;
      pixels_.push_back(pixel);
      in_shadow_.push_back(products.lit[pixel] == 0);
      positions_m.push_back(position_m);
      normals.push_back(at(products.normal, pixel));
    }
  put_on_ground(positions_m, renderer, request);
  light_w_m2_ = light_by_rays(renderer, positions_m, normals, request, strata);
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
