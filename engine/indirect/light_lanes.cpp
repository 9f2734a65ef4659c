#include "engine/indirect/light_lanes.h"

#include <cmath>

#include "dem/support/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/light_lanes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

void Between(std::span<const LightPlace> places, LightPost* out) {
  constexpr int kValues = 8;
  static_assert(sizeof(LightPost) == kValues * sizeof(float));
  const hn::CappedTag<float, kValues> d;
  for (const LightPlace& place : places) {
    const float *south = &place.post->x, *north = &place.post[place.row].x;
    const auto a = hn::Set(d, place.east), b = hn::Set(d, place.north);
    for (int k = 0; k < kValues; k += static_cast<int>(hn::Lanes(d))) {
      const auto sw = hn::LoadU(d, south + k), se = hn::LoadU(d, south + kValues + k);
      const auto nw = hn::LoadU(d, north + k), ne = hn::LoadU(d, north + kValues + k);
      const auto s = hn::Add(sw, hn::Mul(a, hn::Sub(se, sw))), n = hn::Add(nw, hn::Mul(a, hn::Sub(ne, nw)));
      hn::StoreU(hn::Add(s, hn::Mul(b, hn::Sub(n, s))), d, &out->x + k);
    }
    ++out;
  }
}

void FromTerrain(const LightPost* posts, const SurfacePoints& points, const Shading& shading, const Rays& rays,
                 DiffuseLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = static_cast<double>(posts[i].x), y = static_cast<double>(posts[i].y),
                 z = static_cast<double>(posts[i].z), fluence = static_cast<double>(posts[i].fluence);
    const double along = shading.nx[i] * x + shading.ny[i] * y + shading.nz[i] * z;
    const double back = -(rays.dx[i] * x + rays.dy[i] * y + rays.dz[i] * z);
    const double length = std::sqrt(rays.dx[i] * rays.dx[i] + rays.dy[i] * rays.dy[i] + rays.dz[i] * rays.dz[i]);
    const bool lit = points.hit[i] & (fluence > 0) & (along > 0);
    const double share = along / fluence;
    out.mu0[i] = lit ? (share < 1 ? share : 1) : 1e-9;
    out.cos_phase[i] = lit ? back / (length * fluence) : 0;
    out.light[i] = lit ? fluence * static_cast<double>(posts[i].factor) : 0;
  }
}

void FromEarth(const LightPost* posts, const SurfacePoints& points, const Shading& shading, const Rays& rays,
               const Vec3& direction, DiffuseLanes& out) {
  const double x = direction.x(), y = direction.y(), z = direction.z();
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double along = shading.nx[i] * x + shading.ny[i] * y + shading.nz[i] * z;
    const double back = -(rays.dx[i] * x + rays.dy[i] * y + rays.dz[i] * z);
    const double length = std::sqrt(rays.dx[i] * rays.dx[i] + rays.dy[i] * rays.dy[i] + rays.dz[i] * rays.dz[i]);
    const bool lit = points.hit[i] & (posts[i].earth > 0) & (along > 0);
    out.mu0[i] = lit ? along : 1e-9, out.cos_phase[i] = lit ? back / length : 0;
    out.light[i] = lit ? static_cast<double>(posts[i].earth) : 0;
  }
}

void AddReflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double value = lanes.light[i] * reflected[i] * (albedo ? albedo[i] : 1);
    radiance[i] += lanes.light[i] > 0 ? static_cast<float>(value) : 0;
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(Between);
HWY_EXPORT(FromTerrain);
HWY_EXPORT(FromEarth);
HWY_EXPORT(AddReflected);

void posts_between(std::span<const LightPlace> places, LightPost* out) { HWY_DYNAMIC_DISPATCH(Between)(places, out); }

void light_from_terrain(const LightPost (&posts)[kPacket], const SurfacePoints& points, const Shading& shading,
                        const Rays& rays, DiffuseLanes& out) {
  HWY_DYNAMIC_DISPATCH(FromTerrain)(posts, points, shading, rays, out);
}

void light_from_earth(const LightPost (&posts)[kPacket], const SurfacePoints& points, const Shading& shading,
                      const Rays& rays, const Vec3& direction, DiffuseLanes& out) {
  HWY_DYNAMIC_DISPATCH(FromEarth)(posts, points, shading, rays, direction, out);
}

void add_reflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance) {
  HWY_DYNAMIC_DISPATCH(AddReflected)(lanes, reflected, albedo, radiance);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
