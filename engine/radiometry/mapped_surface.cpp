#include "engine/radiometry/mapped_surface.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <string>

#include "dem/error.h"
#include "engine/camera/packet_rays.h"
#include "engine/radiometry/radiometry.h"

namespace selenograph::engine {
namespace {

// Steps of 1.5 %: 500 temperatures.
constexpr double kColdest_k = 5, kHottest_k = 1e4, kStep = 1.015;

Reflectance with_rho(Reflectance reflectance, double rho) {
  reflectance.rho = rho;
  return reflectance;
}

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

double first_value(std::vector<dem::ValueMap::Sampler>& maps, const dem::ValueMap::Footprint2& footprint,
                   double fallback) {
  for (dem::ValueMap::Sampler& map : maps)
    if (const double value = map.mean(footprint); !std::isnan(value)) return value;
  return fallback;
}

// Samples that are no reflectances: most likely of eight bits.
[[noreturn]] void refuse_brightness(double value, const dem::ValueMap::Footprint2& at, const FrameRequest& request,
                                    const StopToken& stop) {
  std::string name;
  for (const auto& map : request.albedo_maps)
    if (name.empty() && !std::isnan(dem::ValueMap::Sampler(*map, stop).mean(at)))
      name = std::filesystem::path(map->path()).filename().string();
  throw ImpossibleRequest(
      fmt::format(
          "the map {} has a reflectance of {:.4g} at {:.4f} N, {:.4f} E, more than all light: give it a \"scale\" "
          "(eight bits: 1/255), or \"high\": 1 to cut off",
          name, value, at.lat_deg, at.lon_deg),
      "albedo_maps");
}

MappedSurface::MappedSurface(const FrameRequest& request, const RowViews& views)
    : request_(request), views_(views), whole_(with_rho(request.reflectance, 1)) {
  const RadianceTerms terms = radiance_terms(request, black(0));
  direct_w_m2_ = terms.direct_w_m2, path_w_m2_sr_ = terms.base_w_m2_sr();
  most_rho_ = request.reflectance.model == ReflectanceModel::lunar_lambert ? kLunarLambertMaxRho : 1;
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

void MappedSurface::radiances(const SurfacePoints& points, const Shading& shading, const Rays& rays, const float* lit,
                              Sampler& sampler, float* out, float* base, int first_row) const {
  Steps steps = steps_;
  for (int i = 0; i < kPacket; ++i) {
    constexpr double kRounding = 1e-6;
    if (!points.hit[i]) continue;
    if (views_.vary()) steps = steps_of(views_.of(first_row + i / kPacketSide));
    const Vec3 direction = rays.direction(i);
    const dem::ValueMap::Footprint2 pixel = footprint(steps, points, i, direction);
    const double albedo = first_value(sampler.albedo, pixel, request_.reflectance.rho);
    if (albedo > most_rho_ + kRounding) refuse_brightness(albedo, pixel, request_, *sampler.stop);
    const double rho = std::clamp(albedo, 0.0, most_rho_);
    double dark = path_w_m2_sr_;
    if (emission_)  // eq. (3)
      dark += (*emission_)(first_value(sampler.temperature, pixel, request_.temperature_k)) * (1 - rho);
    const double cos_phase = -direction.dot(request_.sun.direction) / direction.norm();
    // Eq. (2): all models that have a rho are proportional to it.
    const double direct = rho * direct_radiance(whole_, direct_w_m2_, shading.incident[i], shading.mu[i], cos_phase,
                                                static_cast<double>(lit[i]));
    base[i] = static_cast<float>(dark), out[i] = static_cast<float>(dark + direct);
  }
}

}  // namespace selenograph::engine
