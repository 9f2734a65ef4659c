#include "tests/support/indirect_truth.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "dem/base/quantile.h"
#include "engine/cache/render_context.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/photometry.h"
#include "engine/rays/ray_queries.h"

namespace selenograph::test {
namespace {

using engine::FrameRequest;
using engine::Ray;
using engine::RayHit;
using engine::Renderer;

constexpr int kPointsAlong = 12;

std::vector<RayHit> cast(std::span<const Ray> rays, const Renderer& renderer, const engine::Sun& sun) {
  return renderer.query(
      {}, {}, [&](const engine::RenderContext& context) { return engine::cast_rays(rays, {}, sun, context); });
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

// Appends a point's rays of one azimuth. The elevations move within their strata from azimuth to azimuth by the golden
// section: all rays are a lattice without rows.
void add_azimuth(int azimuth, std::size_t point, const Vec3& position_m, const Vec3& normal,
                 const IndirectTruth::Rays& rays, SphereRays& out) {
  const int strata = rays.strata;
  constexpr double kBorder = 0.4, kPi = std::numbers::pi;
  // Elevation of a low row, which may lie between two strata; rows are denser towards the horizon.
  const auto low = [&](double row) {
    const double u = 2 * row / strata - 1;
    return kBorder * u * (0.15 + 0.85 * u * u);
  };
  // Elevations per row, the derivative of low().
  const auto low_per_row = [&](double row) {
    const double u = 2 * row / strata - 1;
    return kBorder * 2 / strata * (0.15 + 3 * 0.85 * u * u);
  };
  const EastNorthUp axes = local_axes(position_m.normalized());
  const double phi = 2 * kPi * azimuth / rays.azimuths;
  double turns = 0;
  const double offset = std::modf(azimuth / std::numbers::phi, &turns);
  for (int row = 0; row <= strata; ++row) {
    const bool is_low = row < strata;
    const double height = is_low ? low_per_row(row + offset) : kPi / 2 - kBorder;
    const double elevation = is_low ? low(row + offset) : kBorder + offset * height;
    const Vec3 direction =
        std::cos(elevation) * (std::cos(phi) * axes.east + std::sin(phi) * axes.north) + std::sin(elevation) * axes.up;
    const double cosine = direction.dot(normal);
    if (cosine <= 0) continue;
    out.rays.push_back({position_m + 1e-3 * axes.up, direction});
    out.weights.push_back(cosine * std::cos(elevation) * height * 2 * kPi / rays.azimuths);
    out.points.push_back(point);
  }
}

// Adds the light that the rays bring to their points, W m-2.
void add_light(const SphereRays& from, const Renderer& renderer, const FrameRequest& request,
               std::vector<double>& light_w_m2) {
  const std::vector<RayHit> hits = cast(from.rays, renderer, request.sun);
  const engine::Brdf brdf(request.reflectance, engine::band_of(request));
  for (std::size_t i = 0; i < hits.size(); ++i) {
    // Ignore hits on the point's own facet: directions above the interpolated normal's plane may be below the facet's.
    if (!hits[i].hit || hits[i].range_m < 2) continue;
    const double mu0 = hits[i].normal.dot(request.sun.direction);
    if (!(mu0 > 0 && hits[i].lit > 0)) continue;
    const Vec3 back = -from.rays[i].direction;
    light_w_m2[from.points[i]] +=
        engine::kSolarConstant_w_m2 * from.weights[i] * hits[i].lit *
        brdf.times_mu0(mu0, std::max(hits[i].normal.dot(back), 0.0), back.dot(request.sun.direction));
  }
}

// Returns the light that points receive from the ground around them, W m-2, by rays over the sphere of directions.
// Casts all points' rays of an azimuth together: they hit the same terrain, whose acceleration structure each cast
// builds anew.
std::vector<double> light_by_rays(const Renderer& renderer, const std::vector<Vec3>& positions_m,
                                  const std::vector<Vec3>& normals, const FrameRequest& request,
                                  const IndirectTruth::Rays& rays) {
  constexpr std::size_t kMaxRays = 1 << 19;  // some 200 MB with their hits
  std::vector<double> light_w_m2(positions_m.size(), 0);
  SphereRays from;
  for (int azimuth = 0; azimuth < rays.azimuths; ++azimuth) {
    for (std::size_t i = 0; i < positions_m.size(); ++i)
      add_azimuth(azimuth, i, positions_m[i], normals[i], rays, from);
    if (from.rays.size() < kMaxRays && azimuth + 1 < rays.azimuths) continue;
    add_light(from, renderer, request, light_w_m2);
    from = {};
  }
  return light_w_m2;
}

}  // namespace

IndirectTruth::IndirectTruth(const Renderer& renderer, const FrameRequest& request) : request_(request) {
  request_.products = engine::kPosition | engine::kNormal | engine::kLit;
  const engine::FrameProducts products = renderer.render(request_).products;
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
      positions_m_.push_back(position_m);
      normals_.push_back(at(products.normal, pixel));
    }
  request_.products = engine::kIrradiance;
  request_.indirect.terrain = true;
}

IndirectTruth::IndirectTruth(const Renderer& renderer, const FrameRequest& request, const Rays& rays)
    : IndirectTruth(renderer, request) {
  put_on_ground(positions_m_, renderer, request);
  light_w_m2_ = light_by_rays(renderer, positions_m_, normals_, request, rays);
}

IndirectTruth::IndirectTruth(const Renderer& renderer, const FrameRequest& request,
                             const std::function<double(const Vec3& position_m)>& light_w_m2)
    : IndirectTruth(renderer, request) {
  for (const Vec3& position_m : positions_m_) light_w_m2_.push_back(light_w_m2(position_m));
}

IndirectTruth::Error IndirectTruth::of(const std::vector<float>& irradiance) const {
  Error out;
  double ours = 0, truths = 0, squares = 0, shadow_ours = 0, shadow_truths = 0, shadow_squares = 0;
  std::vector<double> differences;
  for (std::size_t i = 0; i < pixels_.size(); ++i) {
    const double light = static_cast<double>(irradiance[3 * pixels_[i] + 1]), truth = light_w_m2_[i];
    if (std::isnan(light) || std::isnan(truth)) continue;
    ours += light;
    truths += truth;
    squares += std::pow(light - truth, 2);
    if (in_shadow_[i]) {
      shadow_ours += light;
      shadow_truths += truth;
      shadow_squares += std::pow(light - truth, 2);
      ++out.shadows;
    }
    differences.push_back(truth > 0 ? std::abs(light / truth - 1) : 0);
    if (truth > 1e-4 * engine::kSolarConstant_w_m2) out.worst = std::max(out.worst, differences.back());
    ++out.places;
  }
  if (out.places == 0 || !(truths > 0)) return out;
  out.median = median(differences);
  out.ratio = ours / truths;
  if (shadow_truths > 0) {
    out.shadow_ratio = shadow_ours / shadow_truths;
    out.shadow_rms = std::sqrt(shadow_squares / out.shadows) / (shadow_truths / out.shadows);
  }
  out.rms = std::sqrt(squares / out.places) / (truths / out.places);
  return out;
}

}  // namespace selenograph::test
