#include "engine/radiometry/mapped_surface.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>

#include "dem/error.h"
#include "engine/camera/packet_rays.h"
#include "engine/radiometry/brdf.h"
#include "engine/radiometry/radiometry.h"

namespace selenograph::engine {
namespace {

// Steps of 1.5 %: 500 temperatures.
constexpr double kColdest_k = 5, kHottest_k = 1e4, kStep = 1.015;

Material black(double temperature_k) {
  Material material;
  material.reflectance.rho = 0, material.temperature_k = temperature_k;
  return material;
}

}  // namespace

EmissionTable::EmissionTable(const FrameRequest& request) {
  const int steps = static_cast<int>(std::log(kHottest_k / kColdest_k) / std::log(kStep)) + 1;
  for (int i = 0; i <= steps; ++i) {
    const double t = kColdest_k * std::pow(kStep, i);
    const double b = radiance_terms(request, black(t)).emitted.value_or(0);
    inverse_k_.push_back(1 / t), log_.push_back(std::log(std::max(b, 1e-300)));
  }
}

double EmissionTable::operator()(double temperature_k) const {
  if (!(temperature_k >= kColdest_k)) return 0;
  const double t = std::min(temperature_k, kHottest_k);
  const auto at = std::min(static_cast<std::size_t>(std::log(t / kColdest_k) / std::log(kStep)), log_.size() - 2);
  const double share = (1 / t - inverse_k_[at]) / (inverse_k_[at + 1] - inverse_k_[at]);
  return std::exp(log_[at] + share * (log_[at + 1] - log_[at]));
}

// Samples that are no reflectances: most likely of eight bits.
[[noreturn]] void refuse_brightness(double value, const dem::ValueMap::Footprint2& at, const FrameRequest& request,
                                    const StopToken& stop) {
  std::string name;
  for (const auto& map : request.albedo_maps)
    if (name.empty() && dem::ValueMap::Sampler(*map, stop).mean(at).value == value)
      name = std::filesystem::path(map->path()).filename().string();
  throw ImpossibleRequest(
      fmt::format(
          "the map {} has a reflectance of {:.4g} at {:.4f} N, {:.4f} E, more than all light: give it a \"scale\" "
          "(eight bits: 1/255), or \"high\": 1 to cut off",
          name, value, at.lat_deg, at.lon_deg),
      "albedo_maps");
}

MappedSurface::MappedSurface(const FrameRequest& request, const RowViews& views)
    : request_(request), views_(views), path_w_m2_sr_(radiance_terms(request, black(0)).base_w_m2_sr()) {
  const Reflectance& reflectance = request.reflectance;
  fallback_ = reflectance.model == ReflectanceModel::hapke ? reflectance.hapke.w : reflectance.rho;
  most_ = reflectance.model == ReflectanceModel::lunar_lambert ? kLunarLambertMaxRho : 1;
  if (request.temperature_k > 0 || !request.temperature_maps.empty())
    emission_ = std::make_unique<const EmissionTable>(request);
  steps_ = steps_of(views.reference());
}

MappedSurface::Steps MappedSurface::steps_of(const View& view) const {
  const Eigen::Matrix3d& m = view.moon_from_camera();
  const double samples = std::sqrt(request_.accuracy.samples_per_pixel);
  Steps steps{m.col(0) / (view.camera().fx * samples), m.col(1) / (view.camera().fy * samples)};
  if (view.projection().fisheye()) steps.fisheye_boresight = m.col(2), steps.angle = 1 / (view.camera().fx * samples);
  return steps;
}

MappedSurface::Sampler MappedSurface::sampler(const StopToken& stop) const {
  Sampler sampler;
  sampler.stop = &stop;
  for (const auto& map : request_.albedo_maps) sampler.albedo.emplace_back(*map, stop);
  for (const auto& map : request_.temperature_maps) sampler.temperature.emplace_back(*map, stop);
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
    if (around.norm() > 1e-9) right = steps.angle * around.normalized(), down = right.cross(direction);
  }
  const Vec3 a = side(right), b = side(down);
  // On the sphere by hand: a texel isn't a matter of the last digits, and to_geographic took a third of the time.
  const double ring = std::max(std::sqrt(place.x() * place.x() + place.y() * place.y()), 1e-6),
               radius = std::sqrt(ring * ring + place.z() * place.z());
  const Vec3 east(-place.y() / ring, place.x() / ring, 0), north = (place / radius).cross(east);
  return {std::atan2(place.z(), ring) * kDegreesPerRadian,
          std::atan2(place.y(), place.x()) * kDegreesPerRadian,
          {a.dot(east), a.dot(north)},
          {b.dot(east), b.dot(north)}};
}

void MappedSurface::sample(const SurfacePoints& points, const Rays& rays, Sampler& sampler, double* albedo, float* base,
                           int first_row) const {
  constexpr double kRounding = 1e-6;
  Steps steps = steps_;
  for (int i = 0; i < kPacket; ++i) {
    albedo[i] = 0;
    if (!points.hit[i]) continue;
    if (views_.vary()) steps = steps_of(views_.of(first_row + i / kPacketSide));
    const dem::ValueMap::Footprint2 pixel = footprint(steps, points, i, rays.direction(i));
    parts_of(sampler.albedo, pixel, fallback_, [&](double value, double share) {
      if (value > most_ + kRounding) refuse_brightness(value, pixel, request_, *sampler.stop);
      albedo[i] += share * std::clamp(value, 0.0, most_);
    });
    double dark = path_w_m2_sr_;
    if (emission_)  // eq. (3)
      parts_of(sampler.temperature, pixel, request_.temperature_k, [&](double temperature_k, double share) {
        dark += share * (*emission_)(temperature_k) * (1 - albedo[i]);
      });
    base[i] = static_cast<float>(dark);
  }
}

}  // namespace selenograph::engine
