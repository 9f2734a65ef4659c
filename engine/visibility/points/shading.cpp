#include "engine/visibility/points/shading.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "dem/base/vector_targets.h"
#include "engine/frame/needs.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/points/shading.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Sets the normal, interpolated between the vertices, and the cosines of incidence and emission. Returns the lanes with
// a hit, one bit each, whose normal faces away from the camera.
unsigned ShadeLanes(const Facets& facets, const SurfacePoints& points, const Rays& rays, const Vec3& sun,
                    Shading& out) {
  const double sx = sun.x();
  const double sy = sun.y();
  const double sz = sun.z();
  alignas(64) std::int64_t away[kPacket];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double v = points.v[i], w = points.w[i], u = 1 - v - w;
    const double x = u * static_cast<double>(facets.normal_a[0][i]) + v * static_cast<double>(facets.normal_b[0][i]) +
                     w * static_cast<double>(facets.normal_c[0][i]);
    const double y = u * static_cast<double>(facets.normal_a[1][i]) + v * static_cast<double>(facets.normal_b[1][i]) +
                     w * static_cast<double>(facets.normal_c[1][i]);
    const double z = u * static_cast<double>(facets.normal_a[2][i]) + v * static_cast<double>(facets.normal_b[2][i]) +
                     w * static_cast<double>(facets.normal_c[2][i]);
    const double dx = rays.dx[i];
    const double dy = rays.dy[i];
    const double dz = rays.dz[i];
    const double normal_dot_ray = x * dx + y * dy + z * dz;
    away[i] = normal_dot_ray >= 0 ? 1 : 0;
    const double inverse_normal = 1 / std::sqrt(x * x + y * y + z * z);
    const double minus_inverse_ray = -1 / std::sqrt(dx * dx + dy * dy + dz * dz);
    out.nx[i] = x * inverse_normal;
    out.ny[i] = y * inverse_normal;
    out.nz[i] = z * inverse_normal;
    const double mu0 = (x * sx + y * sy + z * sz) * inverse_normal;
    out.mu0[i] = mu0;
    out.incident[i] = mu0;  // a Sun with a disc replaces it by the mean over the disc (DiscLight)
    out.mu[i] = normal_dot_ray * inverse_normal * minus_inverse_ray;
  }
  unsigned away_lanes = 0;
  std::int64_t any_away = 0;
  for (int i = 0; i < kPacket; ++i) any_away |= away[i] & static_cast<std::int64_t>(points.hit[i]);
  if (any_away == 0) return 0;  // skip the scalar loop: nearly all normals face the camera
  for (unsigned i = 0; i < kPacket; ++i) away_lanes |= away[i] && points.hit[i] ? 1U << i : 0U;
  return away_lanes;
}

// Computes the radiance of a model with closed terms. `albedo`: factor per lane, or null.
void RadiancesOf(const BrdfTerms& terms, double irradiance, const Shading& shading, const double* albedo,
                 const float* lit, float* out) {
  double factor[kPacket];
  for (int i = 0; i < kPacket; ++i) factor[i] = albedo ? irradiance * albedo[i] : irradiance;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i)
    out[i] = static_cast<float>(
        direct_radiance(terms, factor[i], shading.incident[i], shading.mu[i], static_cast<double>(lit[i])));
}

// Computes the cosines of the phase angle and of emission; the latter is at least 0.
void Cosines(const Rays& rays, const Shading& shading, const Vec3& sun, double* cos_phase, double* mu) {
  const double sx = sun.x();
  const double sy = sun.y();
  const double sz = sun.z();
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i];
    cos_phase[i] = -(dx * sx + dy * sy + dz * sz) / std::sqrt(dx * dx + dy * dy + dz * dz);
    mu[i] = shading.mu[i] > 0 ? shading.mu[i] : 0;
  }
}

// Computes radiance as direct_radiance does, for reflectances that were evaluated before. `albedo`: factor per lane, or
// null.
void ReflectedBy(double irradiance, const Shading& shading, const double* mu0_brdf, const double* albedo,
                 const float* lit, float* out) {
  double factor[kPacket];
  for (int i = 0; i < kPacket; ++i) factor[i] = albedo ? irradiance * albedo[i] : irradiance;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double value = factor[i] * mu0_brdf[i] * static_cast<double>(lit[i]);
    out[i] = static_cast<float>(shading.incident[i] > 0 && lit[i] > 0 ? value : 0.0);
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(ShadeLanes);
HWY_EXPORT(RadiancesOf);
HWY_EXPORT(Cosines);
HWY_EXPORT(ReflectedBy);

namespace {

bool mapped(const FrameRequest& request) {
  return wants_albedo(request) && !(request.albedo_maps.empty() && request.temperature_maps.empty());
}

// Returns the reflectance with rho = 1 where the albedo varies: all models that have a rho are proportional to it, so
// the albedo multiplies the result, eq. (2).
Reflectance evaluated_reflectance(const FrameRequest& request, bool varies) {
  Reflectance reflectance = request.reflectance;
  if (varies) reflectance.rho = 1;
  return reflectance;
}

}  // namespace

PacketShader::PacketShader(const FrameRequest& request, const RowViews& views, const Mesh& mesh,
                           const RadianceTerms& terms, const TerrainLight* indirect)
    : request_(request),
      irradiance_(terms.direct_w_m2),
      base_(static_cast<float>(terms.base_w_m2_sr())),
      albedo_(request.reflectance),
      varied_(mesh.varies_in_brightness() ? &mesh : nullptr),
      brdf_(evaluated_reflectance(request, varied_ || engine::mapped(request)), band_of(request)),
      indirect_(indirect) {
  if (engine::mapped(request)) mapped_.emplace(request, views);
}

// Use the normal of the facet if the interpolated one faces away from the camera: visible facets face it, and otherwise
// slopes at grazing angles have black specks at opposition.
void PacketShader::shade(const Facets& facets, const SurfacePoints& points, const Rays& rays, Shading& out) const {
  const Vec3& sun = request_.sun.direction;
  for (unsigned away = HWY_DYNAMIC_DISPATCH(ShadeLanes)(facets, points, rays, sun, out); away; away &= away - 1) {
    const int i = std::countr_zero(away);
    const Vec3 normal = points.facet_normal(i).normalized();
    out.nx[i] = normal.x();
    out.ny[i] = normal.y();
    out.nz[i] = normal.z();
    out.mu0[i] = out.incident[i] = normal.dot(sun);
    out.mu[i] = -normal.dot(rays.direction(i)) / rays.direction(i).norm();
  }
}

void PacketShader::albedos(const SurfacePoints& points, const Rays& rays, Sampler& sampler, double* albedo, float* base,
                           const PacketRows& rows) const {
  if (mapped_)
    mapped_->sample(points, rays, sampler, albedo, base, rows);
  else
    std::fill_n(albedo, kPacket, albedo_.constant);
  if (!varied_) return;
  float brightness[kPacket];
  interpolate_brightness(*varied_, points, brightness);
  for (int i = 0; i < kPacket; ++i)
    albedo[i] = std::min(albedo[i] * static_cast<double>(brightness[i]), albedo_.largest);
}

// Sets the radiance of direct sunlight, then adds the base: emission and indirect light per lane, or one constant. The
// Hapke model takes the albedo of a map as an argument; all others are multiplied by it.
void PacketShader::radiances(const SurfacePoints& points, const Shading& shading, const Rays& rays, const float* lit,
                             Sampler& sampler, float* out, float* base, const PacketRows& rows) const {
  alignas(64) double albedo[kPacket];
  const bool varies = mapped_ || varied_;
  if (varies) albedos(points, rays, sampler, albedo, base, rows);
  if (const BrdfTerms* terms = brdf_.terms()) {
    HWY_DYNAMIC_DISPATCH(RadiancesOf)(*terms, irradiance_, shading, varies ? albedo : nullptr, lit, out);
  } else {
    alignas(64) double cos_phase[kPacket];
    alignas(64) double mu[kPacket];
    alignas(64) double mu0_brdf[kPacket];
    HWY_DYNAMIC_DISPATCH(Cosines)(rays, shading, request_.sun.direction, cos_phase, mu);
    brdf_.times_mu0(shading.incident, mu, cos_phase, varies && albedo_.is_w ? albedo : nullptr, mu0_brdf);
    HWY_DYNAMIC_DISPATCH(ReflectedBy)
    (irradiance_, shading, mu0_brdf, varies && !albedo_.is_w ? albedo : nullptr, lit, out);
  }
  if (indirect_) {
    if (!(mapped_ && mapped_->emits())) std::fill_n(base, kPacket, base_);
    indirect_->add(points, shading, rays, brdf_, varies ? albedo : nullptr, base);
  }
  if (bases_vary()) {
    for (int i = 0; i < kPacket; ++i) out[i] += points.hit[i] ? base[i] : 0;
  } else if (base_ != 0) {
    for (int i = 0; i < kPacket; ++i) out[i] += base_;  // eq. (1)
  }
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
