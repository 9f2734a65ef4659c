#include "engine/radiometry/mapped_surface.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
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

// False: the lanes are too far apart for its series. Where there is no hit, numbers without a meaning.
bool FootprintsNear(const Near& near, const Vec3& right, const Vec3& down, const SurfacePoints& p, const Rays& rays,
                    FootprintLanes& out) {
  // Radians, from the reference place, which may be 3.5 km off. The next terms of the series are 1e-12 of the
  // Moon's radius.
  constexpr double kFarthest = 5e-3;
  const double ex = near.east.x(), ey = near.east.y(), nx = near.north.x(), ny = near.north.y(), nz = near.north.z(),
               ux = near.up.x(), uy = near.up.y(), uz = near.up.z();
  const double sine = near.sin_lat, cosine = near.cos_lat;
  alignas(64) double off[kPacket];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = p.x[i] * ex + p.y[i] * ey, y = p.x[i] * nx + p.y[i] * ny + p.z[i] * nz,
                 z = p.x[i] * ux + p.y[i] * uy + p.z[i] * uz;
    const double axis = z * sine + y * cosine, meridian = z * cosine - y * sine;
    // Square roots of 1 + tan^2 by their series: the next terms are 1e-14.
    const double tan_lon = x / meridian, lon2 = tan_lon * tan_lon;
    const double ring = meridian * (1 + lon2 * (0.5 - lon2 * 0.125));
    const double tan_lat = (axis * cosine - ring * sine) / (ring * cosine + axis * sine), lat2 = tan_lat * tan_lat;
    out.lon_deg[i] = near.lon_deg + kDegreesPerRadian * tan_lon * (1 - lon2 / 3);
    out.lat_deg[i] = near.lat_deg + kDegreesPerRadian * tan_lat * (1 - lat2 / 3);
    out.cos_lat[i] = (cosine - sine * tan_lat) * (1 - lat2 * (0.5 - lat2 * 0.375));
    off[i] = std::abs(tan_lon) + std::abs(tan_lat);

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
  for (int i = 0; i < kPacket; ++i) near_all &= !p.hit[i] || off[i] < kFarthest;
  return near_all;
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(FootprintsNear);

namespace {

// Steps of 1.5 %: 500 temperatures.
constexpr double kColdest_k = 5, kHottest_k = 1e4, kStep = 1.015;

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

// What a map's value is multiplied by.
double albedo_scale(const dem::ValueMap& map, const Reflectance& reflectance, const StopToken& stop) {
  if (!map.radiance_factor()) return 1;
  if (reflectance.model == ReflectanceModel::moon)
    if (const auto mean = near_side_mean(map, stop)) return 1 / *mean;
  const dem::RadianceFactor& at = *map.radiance_factor();
  const auto cosine = [](double degrees) { return std::cos(degrees * kRadiansPerDegree); };
  const double mu0 = cosine(at.incidence_deg);
  constexpr double kNarrow_um = 1e-3;
  const Band band(at.wavelength_um, kNarrow_um);
  Reflectance whole = reflectance;
  whole.rho = 1;
  return 1 / (std::numbers::pi * Brdf(whole, &band).times_mu0(mu0, cosine(at.emission_deg), cosine(at.phase_deg)));
}

// Samples that are no reflectances: most likely of eight bits.
[[noreturn]] void refuse_brightness(double value, const dem::ValueMap::Footprint2& at, const FrameRequest& request,
                                    std::vector<ScaledMap>& maps) {
  // The map that has this value here, to rounding.
  std::string name;
  double sample = value, nearest = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < maps.size(); ++i) {
    const double mean = maps[i].map.mean(at).value, off = std::abs(mean * maps[i].scale - value);
    if (!(off < nearest)) continue;
    nearest = off;
    sample = mean;
    name = std::filesystem::path(request.albedo_maps[i]->path()).filename().string();
  }
  const std::string place = fmt::format("{:.4f} N, {:.4f} E", at.lat_deg, at.lon_deg);
  throw ImpossibleRequest(
      sample > 1
          ? fmt::format("the map {} has a reflectance of {:.4g} at {}, more than all light: give it a \"scale\" "
                        "(eight bits: 1/255), or \"high\": 1 to cut off",
                        name, sample, place)
          : fmt::format("the map {} has {:.4g} at {}, which the request's reflectance makes a parameter of {:.4g}: "
                        "more than all light",
                        name, sample, place, value),
      "albedo_maps");
}

// What a sample may be above the most that a reflectance can be.
constexpr double kRounding = 1e-6;

// False, with numbers without a meaning, if a value is too large.
bool scaled_albedo(const double* values, double scale, double most, double* albedo) {
  double highest = 0;
  for (int i = 0; i < kPacket; ++i) {
    const double value = values[i] * scale;
    highest = std::max(highest, value);
    albedo[i] = std::clamp(value, 0.0, most);
  }
  return highest <= most + kRounding;
}

}  // namespace

AlbedoMaps::AlbedoMaps(const FrameRequest& request) : maps_(request.albedo_maps) {
  const Reflectance& reflectance = request.reflectance;
  const bool moon = reflectance.model == ReflectanceModel::moon;
  fallback_ = moon ? 1 : reflectance.model == ReflectanceModel::hapke ? reflectance.hapke.w : reflectance.rho;
  most_ = moon ? kMoonMost : reflectance.model == ReflectanceModel::lunar_lambert ? kLunarLambertMaxRho : 1;
  for (const auto& map : maps_) scales_.push_back(albedo_scale(*map, reflectance, {}));
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
  const Eigen::Matrix3d& m = view.moon_from_camera();
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

// What the pixel's rays meet of the facet's plane: Igehy, Tracing ray differentials (SIGGRAPH 1999). The lens's own
// stretch is left out.
dem::ValueMap::Footprint2 MappedSurface::footprint(const Steps& steps, const SurfacePoints& points, int i,
                                                   const Vec3& direction) {
  const Vec3 place = points.position(i), facet = points.facet_normal(i);
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
  const Near at(place);
  return {at.lat_deg, at.lon_deg, {a.dot(at.east), a.dot(at.north)}, {b.dot(at.east), b.dot(at.north)}, at.cos_lat};
}

void MappedSurface::footprints(const SurfacePoints& points, const Rays& rays, int first_row, NearPlaces& near,
                               FootprintLanes& out) const {
  const int first = std::countr_zero(hit_bits(points));
  if (!steps_.fisheye_boresight && !views_.vary() &&
      HWY_DYNAMIC_DISPATCH(FootprintsNear)(near.of(points.position(first)), steps_.right, steps_.down, points, rays,
                                           out))
    return;
  Steps steps = steps_;
  for (int i = first; i < kPacket; ++i) {
    if (!points.hit[i]) continue;
    if (views_.vary()) steps = steps_of(views_.of(first_row + i / kPacketSide));
    out.set(i, footprint(steps, points, i, rays.direction(i)));
  }
}

void MappedSurface::sample(const SurfacePoints& points, const Rays& rays, Sampler& sampler, double* albedo, float* base,
                           int first_row) const {
  std::fill(albedo, albedo + kPacket, 0.0);
  const std::uint32_t hits = hit_bits(points);
  if (hits == 0) return;
  FootprintLanes pixels;
  footprints(points, rays, first_row, sampler.near, pixels);
  alignas(64) double values[kPacket];
  const auto small_of = [&](std::vector<ScaledMap>& maps) {
    return maps.empty() ? 0 : maps.front().map.means_of_small(pixels.all(), hits, values);
  };
  // part(value, share, lane) of each pixel's parts. Of several maps the first decides where it has values.
  const auto each = [&](std::vector<ScaledMap>& maps, std::uint32_t small, double fallback, const auto& part) {
    for (int i = 0; i < kPacket; ++i) {
      if (!points.hit[i]) continue;
      if (small >> i & 1)
        part(values[i] * maps.front().scale, 1.0, i);
      else
        parts_of(maps, pixels.at(i), fallback, [&](double value, double share) { part(value, share, i); });
    }
  };
  const std::uint32_t small = small_of(sampler.albedo);
  if (small != kAllLanes || !scaled_albedo(values, sampler.albedo.front().scale, albedo_.most(), albedo))
    each(sampler.albedo, small, albedo_.fallback(), [&](double value, double share, int i) {
      if (value > albedo_.most() + kRounding) refuse_brightness(value, pixels.at(i), request_, sampler.albedo);
      albedo[i] += share * std::clamp(value, 0.0, albedo_.most());
    });
  if (!emission_) return;
  alignas(64) double emitted[kPacket] = {};  // eq. (3)
  each(sampler.temperature, small_of(sampler.temperature), request_.temperature_k,
       [&](double temperature_k, double share, int i) {
         emitted[i] += share * (*emission_)(temperature_k) * (1 - albedo[i]);
       });
  for (int i = 0; i < kPacket; ++i) base[i] = static_cast<float>(path_w_m2_sr_ + emitted[i]);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
