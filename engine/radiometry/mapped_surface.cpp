#include "engine/radiometry/mapped_surface.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <filesystem>
#include <limits>
#include <numbers>
#include <string>

#include "dem/base/error.h"
#include "dem/base/vector_targets.h"
#include "engine/camera/packet_rays.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/footprint_lanes.h"
#include "engine/radiometry/moon.h"
#include "engine/radiometry/radiometry.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/radiometry/mapped_surface.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Sets sixteen footprints by series around a reference position. Returns false if a hit is too far away for the series.
// Lanes without a hit get meaningless numbers.
bool FootprintsBySeries(const ReferencePosition& reference, const Vec3& right, const Vec3& down, const SurfacePoints& p,
                        const Rays& rays, FootprintLanes& out) {
  // Largest angle from the reference position, radians; the position may be 3.5 km off. The next terms of the series
  // are 1e-12 of the Moon's radius.
  constexpr double kFarthest = 5e-3;
  const double ex = reference.east.x(), ey = reference.east.y();
  const double nx = reference.north.x(), ny = reference.north.y(), nz = reference.north.z();
  const double ux = reference.up.x(), uy = reference.up.y(), uz = reference.up.z();
  const double sine = reference.sin_lat, cosine = reference.cos_lat;
  alignas(64) double angle_from_reference[kPacket];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = p.x[i] * ex + p.y[i] * ey, y = p.x[i] * nx + p.y[i] * ny + p.z[i] * nz,
                 z = p.x[i] * ux + p.y[i] * uy + p.z[i] * uz;
    // From axes east, north, up at the reference to axes of the globe: `axis` toward the pole, `meridian` in the
    // reference's meridian. `ring` is the distance from the polar axis.
    const double axis = z * sine + y * cosine, meridian = z * cosine - y * sine;
    // Square roots of 1 + tan^2 by series: the next terms are 1e-14.
    const double tan_lon = x / meridian, lon2 = tan_lon * tan_lon;
    const double ring = meridian * (1 + lon2 * (0.5 - lon2 * 0.125));
    const double tan_lat = (axis * cosine - ring * sine) / (ring * cosine + axis * sine), lat2 = tan_lat * tan_lat;
    out.lon_deg[i] = reference.lon_deg + kDegreesPerRadian * tan_lon * (1 - lon2 / 3);
    out.lat_deg[i] = reference.lat_deg + kDegreesPerRadian * tan_lat * (1 - lat2 / 3);
    out.cos_lat[i] = (cosine - sine * tan_lat) * (1 - lat2 * (0.5 - lat2 * 0.375));
    angle_from_reference[i] = std::abs(tan_lon) + std::abs(tan_lat);

    // The same as MappedSurface::footprint(): a step of the ray moves the hit by distance * (step - direction * (facet
    // . step) / (facet . direction)) on the facet's plane; r: for the step to the right, b: for that down.
    const double dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i];
    const double fx = p.nx[i], fy = p.ny[i], fz = p.nz[i], toward = p.distance[i] / (fx * dx + fy * dy + fz * dz);
    const double along_right = toward * (fx * right.x() + fy * right.y() + fz * right.z()),
                 along_down = toward * (fx * down.x() + fy * down.y() + fz * down.z());
    const double t = p.distance[i];
    const double rx = t * right.x() - dx * along_right, ry = t * right.y() - dy * along_right,
                 rz = t * right.z() - dz * along_right;
    const double bx = t * down.x() - dx * along_down, by = t * down.y() - dy * along_down,
                 bz = t * down.z() - dz * along_down;
    out.right_m[0][i] = rx * ex + ry * ey;
    out.right_m[1][i] = rx * nx + ry * ny + rz * nz;
    out.down_m[0][i] = bx * ex + by * ey;
    out.down_m[1][i] = bx * nx + by * ny + bz * nz;
  }
  bool near_all = true;
  for (int i = 0; i < kPacket; ++i) near_all &= !p.hit[i] || angle_from_reference[i] < kFarthest;
  return near_all;
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(FootprintsBySeries);

namespace {

// Range and step (1.5 %) of the table's temperatures: 500 entries.
constexpr double kColdest_k = 5, kHottest_k = 1e4, kStep = 1.015;

// Returns a material that emits as a blackbody and reflects nothing.
Material black(double temperature_k) {
  Material material;
  material.reflectance.rho = 0;
  material.temperature_k = temperature_k;
  return material;
}

}  // namespace

EmissionTable::EmissionTable(const FrameRequest& request) {
  const int steps = static_cast<int>(std::log(kHottest_k / kColdest_k) / std::log(kStep)) + 1;
  for (int i = 0; i <= steps; ++i) {
    const double t = kColdest_k * std::pow(kStep, i);
    const double b = radiance_terms(request, black(t)).emitted.value_or(0);
    inverse_k_.push_back(1 / t);
    log_.push_back(std::log(std::max(b, 1e-300)));
  }
}

double EmissionTable::operator()(double temperature_k) const {
  if (!(temperature_k >= kColdest_k)) return 0;
  const double t = std::min(temperature_k, kHottest_k);
  const auto at = std::min(static_cast<std::size_t>(std::log(t / kColdest_k) / std::log(kStep)), log_.size() - 2);
  const double share = (1 / t - inverse_k_[at]) / (inverse_k_[at + 1] - inverse_k_[at]);
  return std::exp(log_[at] + share * (log_[at + 1] - log_[at]));
}

namespace {

// Returns the factor from a map's values to the parameter of the reflectance. A map of radiance factors, pi f_r mu0 in
// the geometry that it names, is divided by the model's own there; for the model `moon`, by its near-side mean.
double albedo_scale(const dem::ValueMap& map, const Reflectance& reflectance, const StopToken& stop) {
  if (!map.radiance_factor()) return 1;
  if (reflectance.model == ReflectanceModel::moon)
    if (const auto mean = near_side_mean(map, stop)) return 1 / *mean;
  const dem::RadianceFactor& at = *map.radiance_factor();
  const auto cosine = [](double degrees) { return std::cos(degrees * kRadiansPerDegree); };
  const double mu0 = cosine(at.incidence_deg);
  constexpr double kNarrow_um = 1e-3;
  const Band band(at.wavelength_um, kNarrow_um);
  Reflectance white = reflectance;
  white.rho = 1;
  return 1 / (std::numbers::pi * Brdf(white, &band).times_mu0(mu0, cosine(at.emission_deg), cosine(at.phase_deg)));
}

// Throws ImpossibleRequest for a sample that is no reflectance: the map most likely holds eight bits.
[[noreturn]] void refuse_brightness(double value, const dem::ValueMap::Footprint2& at, const FrameRequest& request,
                                    std::vector<ScaledMap>& maps) {
  // Find the map whose value here equals this one, except for rounding.
  std::string name;
  double sample = value, nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < maps.size(); ++i) {
    const double mean = maps[i].map.mean(at).value, difference = std::abs(mean * maps[i].scale - value);
    if (!(difference < nearest)) continue;
    nearest = difference;
    sample = mean;
    name = std::filesystem::path(request.albedo_maps[i]->path()).filename().string();
  }
  const std::string coordinates = fmt::format("{:.4f} N, {:.4f} E", at.lat_deg, at.lon_deg);
  throw ImpossibleRequest(
      sample > 1
          ? fmt::format("the map {} has a reflectance of {:.4g} at {}, more than all light: give it a \"scale\" "
                        "(eight bits: 1/255), or \"high\": 1 to cut off",
                        name, sample, coordinates)
          : fmt::format("the map {} has {:.4g} at {}, which the request's reflectance makes a parameter of {:.4g}: "
                        "more than all light",
                        name, sample, coordinates, value),
      "albedo_maps");
}

// Tolerance of samples above the largest reflectance.
constexpr double kRounding = 1e-6;

// Scales sixteen samples. Returns false, with meaningless numbers, if a value is too large.
bool scaled_albedo(const double* values, double scale, double max_value, double* albedo) {
  double highest = 0;
  for (int i = 0; i < kPacket; ++i) {
    const double value = values[i] * scale;
    highest = std::max(highest, value);
    albedo[i] = std::clamp(value, 0.0, max_value);
  }
  return highest <= max_value + kRounding;
}

}  // namespace

Albedo::Albedo(const Reflectance& reflectance) : is_w(reflectance.model == ReflectanceModel::hapke) {
  const bool moon = reflectance.model == ReflectanceModel::moon;
  constant = moon ? 1 : is_w ? reflectance.hapke.w : reflectance.rho;
  largest = moon ? kMoonMaxRatio : reflectance.model == ReflectanceModel::lunar_lambert ? kLunarLambertMaxRho : 1;
}

AlbedoMaps::AlbedoMaps(const FrameRequest& request) : maps_(request.albedo_maps), albedo_(request.reflectance) {
  for (const auto& map : maps_) scales_.push_back(albedo_scale(*map, request.reflectance, {}));
}

std::vector<ScaledMap> AlbedoMaps::sampled(const StopToken& stop) const {
  std::vector<ScaledMap> maps;
  for (std::size_t i = 0; i < maps_.size(); ++i) maps.push_back({{*maps_[i], stop}, scales_[i]});
  return maps;
}

MappedSurface::MappedSurface(const FrameRequest& request, const RowViews& views)
    : request_(request),
      views_(views),
      albedo_(request),
      path_w_m2_sr_(radiance_terms(request, black(0)).base_w_m2_sr()) {
  if (request.temperature_k > 0 || !request.temperature_maps.empty())
    emission_ = std::make_unique<const EmissionTable>(request);
  steps_ = steps_of(views.reference());
}

MappedSurface::Steps MappedSurface::steps_of(const View& view) const {
  const Mat3& m = view.moon_from_camera();
  const double samples = std::sqrt(request_.accuracy.samples_per_pixel);
  Steps steps{m.col(0) / (view.camera().fx * samples), m.col(1) / (view.camera().fy * samples)};
  if (view.projection().fisheye()) {
    steps.fisheye_boresight = m.col(2);
    steps.angle = 1 / (view.camera().fx * samples);
  }
  return steps;
}

MappedSurface::Sampler MappedSurface::sampler(const StopToken& stop) const {
  Sampler sampler;
  sampler.albedo = albedo_.sampled(stop);
  for (const auto& map : request_.temperature_maps) sampler.temperature.push_back({{*map, stop}});
  return sampler;
}

// Returns the area of the facet's plane that the pixel's rays hit: Igehy, Tracing ray differentials (SIGGRAPH 1999).
// The lens's own stretch is left out.
dem::ValueMap::Footprint2 MappedSurface::footprint(const Steps& steps, const SurfacePoints& points, int i,
                                                   const Vec3& direction) {
  const Vec3 position = points.position(i), facet = points.facet_normal(i);
  const double toward = facet.dot(direction);
  const auto side = [&](const Vec3& step) -> Vec3 {
    return points.distance[i] * (step - direction * (facet.dot(step) / toward));
  };
  Vec3 right = steps.right, down = steps.down;
  if (steps.fisheye_boresight) {  // away from the boresight, and around it
    const Vec3 around = steps.fisheye_boresight->cross(direction);
    if (around.norm() > 1e-9) {
      right = steps.angle * around.normalized();
      down = right.cross(direction);
    }
  }
  const Vec3 a = side(right), b = side(down);
  const ReferencePosition local(position);
  return {local.lat_deg,
          local.lon_deg,
          {a.dot(local.east), a.dot(local.north)},
          {b.dot(local.east), b.dot(local.north)},
          local.cos_lat};
}

void MappedSurface::footprints(const SurfacePoints& points, const Rays& rays, const PacketRows& rows,
                               ReferencePositions& references, FootprintLanes& out) const {
  const int first = std::countr_zero(hit_bits(points));
  if (!steps_.fisheye_boresight && !views_.vary() &&
      HWY_DYNAMIC_DISPATCH(FootprintsBySeries)(references.of(points.position(first)), steps_.right, steps_.down, points,
                                               rays, out))
    return;
  Steps steps = steps_;
  for (int i = first; i < kPacket; ++i) {
    if (!points.hit[i]) continue;
    if (views_.vary()) steps = steps_of(views_.of(rows.of(i)));
    out.set(i, footprint(steps, points, i, rays.direction(i)));
  }
}

void MappedSurface::sample(const SurfacePoints& points, const Rays& rays, Sampler& sampler, double* albedo, float* base,
                           const PacketRows& rows) const {
  std::fill(albedo, albedo + kPacket, 0.0);
  const std::uint32_t hits = hit_bits(points);
  if (hits == 0) return;
  FootprintLanes pixels;
  footprints(points, rays, rows, sampler.references, pixels);
  alignas(64) double values[kPacket];
  // Sets `values` of the lanes whose footprints are smaller than a texel, and returns these lanes as bits.
  const auto small_of = [&](std::vector<ScaledMap>& maps) {
    return maps.empty() ? 0 : maps.front().map.means_of_small(pixels.all(), hits, values);
  };
  // Calls visit(value, share, lane) for the parts of each pixel. Of several maps the first one with a value decides.
  const auto for_each_part = [&](std::vector<ScaledMap>& maps, std::uint32_t small, double fallback,
                                 const auto& visit) {
    for (int i = 0; i < kPacket; ++i) {
      if (!points.hit[i]) continue;
      if (small >> i & 1)
        visit(values[i] * maps.front().scale, 1.0, i);
      else
        visit_coverage(maps, pixels.at(i), fallback, [&](double value, double share) { visit(value, share, i); });
    }
  };
  // If all lanes are small, scale them at once; only a value that is too large takes the slow way, which throws.
  const std::uint32_t small = small_of(sampler.albedo);
  if (small != kAllLanes || !scaled_albedo(values, sampler.albedo.front().scale, albedo_.max_value(), albedo))
    for_each_part(sampler.albedo, small, albedo_.fallback(), [&](double value, double share, int i) {
      if (value > albedo_.max_value() + kRounding) refuse_brightness(value, pixels.at(i), request_, sampler.albedo);
      albedo[i] += share * std::clamp(value, 0.0, albedo_.max_value());
    });
  if (!emission_) return;
  alignas(64) double emitted[kPacket] = {};  // eq. (3)
  for_each_part(sampler.temperature, small_of(sampler.temperature), request_.temperature_k,
                [&](double temperature_k, double share, int i) {
                  emitted[i] += share * (*emission_)(temperature_k) * (1 - albedo[i]);
                });
  for (int i = 0; i < kPacket; ++i) base[i] = static_cast<float>(path_w_m2_sr_ + emitted[i]);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
