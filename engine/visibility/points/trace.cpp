#include "engine/visibility/points/trace.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/points/trace.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_TRACE_SHARED
#define SELENOGRAPH_ENGINE_TRACE_SHARED
namespace selenograph::engine {

// Returns whether a ray enters a sphere or, from inside, heads toward its centre. origin2 and passing2: squared
// distances from the centre of the ray's origin and of its closest point. ahead: the closest point lies in front of the
// origin.
inline bool aims_into_sphere(double radius2, double origin2, double passing2, bool ahead) {
  return ahead && (origin2 <= radius2 || passing2 <= radius2);
}

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Rounding error of a point and of the plane of its triangle in float, as a share of the largest coordinate.
constexpr float kRounding = 0x1p-22F;

// Returns a positive number if a triangle faces the Sun and the interior of the Moon (below all relief) is not in
// between. A selected number lets the compiler vectorise loops over lanes; a logical `and` does not.
inline double toward_sun(const SurfacePoints& p, int i, double sx, double sy, double sz) {
  constexpr double kCore2 = dem::kCoreRadius_m * dem::kCoreRadius_m;
  const double x = p.x[i];
  const double y = p.y[i];
  const double z = p.z[i];
  const double along = x * sx + y * sy + z * sz;
  const double off_axis2 = x * x + y * y + z * z - along * along, behind2 = along < 0 ? off_axis2 : kCore2;
  const double toward = p.nx[i] * sx + p.ny[i] * sy + p.nz[i] * sz;
  return behind2 < kCore2 ? 0 : toward;
}

// Sets each lane's ray in float, relative to the anchor. It starts where the ray enters the scene's shell, or at the
// origin of a ray from inside. `active`: the ray enters the shell; toward_moon: it also meets the core.
//
//             half chord
//            |<------->|
//   origin o-+---------+---------+-->  shell: around the scene
//         entry     closest
//                      |               passing: from the closest point to the Moon's centre,
//                      o               at most the radius of the core if the ray meets it
void ClipToShell(const Rays& rays, double shell_m, double core_m, const Vec3& anchor, RayPacket& packet,
                 std::int32_t* toward_moon) {
  const double shell2 = shell_m * shell_m;
  const double core2 = core_m * core_m;
  const double ax = anchor.x();
  const double ay = anchor.y();
  const double az = anchor.z();
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double ox = rays.ox[i];
    const double oy = rays.oy[i];
    const double oz = rays.oz[i];
    const double dx = rays.dx[i];
    const double dy = rays.dy[i];
    const double dz = rays.dz[i];
    const double origin2 = ox * ox + oy * oy + oz * oz;
    const double direction2 = dx * dx + dy * dy + dz * dz;
    const double closest = -(ox * dx + oy * dy + oz * dz) / direction2;
    // Compute the passing distance from the closest point: origin2 - closest^2 would cancel for a distant camera.
    const double x = ox + closest * dx;
    const double y = oy + closest * dy;
    const double z = oz + closest * dz;
    const double passing2 = x * x + y * y + z * z;
    const double half_chord2 = (shell2 - passing2) / direction2;
    const bool inside = origin2 <= shell2;
    const bool enters = inside || (closest > 0 && half_chord2 >= 0);
    const double t = inside || !enters ? 0 : closest - std::sqrt(half_chord2 > 0 ? half_chord2 : 0);
    packet.ox[i] = static_cast<float>(ox + t * dx - ax);
    packet.oy[i] = static_cast<float>(oy + t * dy - ay);
    packet.oz[i] = static_cast<float>(oz + t * dz - az);
    packet.dx[i] = static_cast<float>(dx);
    packet.dy[i] = static_cast<float>(dy);
    packet.dz[i] = static_cast<float>(dz);
    packet.active[i] = enters ? -1 : 0;
    toward_moon[i] = aims_into_sphere(core2, origin2, passing2, closest > 0) ? 1 : 0;
  }
}

// Sets, per lane, a ray from the point toward the Sun. `active`: the facet faces the Sun, and the interior of the Moon
// (below all relief) is not in between.
//
// `near` skips the surface that the ray leaves, which lies within the rounding error of the start. If Embree found and
// then dropped that surface, its packets would not test the other half of the quad. The flatter the ray, the longer
// `near`. Terrain that rises within `near` is hit where the ray leaves it. burial_m: distance along the ray up to which
// it may be below ground, since its rounded start may be.
void StartShadowRays(const SurfacePoints& p, const Vec3& anchor, const Vec3& sun, RayPacket& packet, float* rounding_m,
                     float* burial_m) {
  const double ax = anchor.x();
  const double ay = anchor.y();
  const double az = anchor.z();
  const double sx = sun.x();
  const double sy = sun.y();
  const double sz = sun.z();
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = p.x[i];
    const double y = p.y[i];
    const double z = p.z[i];
    const double nx = p.nx[i];
    const double ny = p.ny[i];
    const double nz = p.nz[i];
    const double area = std::sqrt(nx * nx + ny * ny + nz * nz);
    const double facing = nx * sx + ny * sy + nz * sz;
    const double sine = facing / area;
    // Add the size of the triangle: near the anchor its vertices are farther from the anchor than the point.
    const double rx = x - ax;
    const double ry = y - ay;
    const double rz = z - az;
    const double size = std::abs(rx) + std::abs(ry) + std::abs(rz) + 4 * std::sqrt(area);
    const double rounding = size * static_cast<double>(kRounding);
    rounding_m[i] = static_cast<float>(rounding);
    packet.ox[i] = static_cast<float>(rx);
    packet.oy[i] = static_cast<float>(ry);
    packet.oz[i] = static_cast<float>(rz);
    packet.dx[i] = static_cast<float>(sx);
    packet.dy[i] = static_cast<float>(sy);
    packet.dz[i] = static_cast<float>(sz);
    packet.near[i] = static_cast<float>(rounding / (sine > 1.0 / 64 ? sine : 1.0 / 64));
    const double ex = rx - static_cast<double>(packet.ox[i]);
    const double ey = ry - static_cast<double>(packet.oy[i]);
    const double ez = rz - static_cast<double>(packet.oz[i]);
    const double beneath = (nx * ex + ny * ey + nz * ez) / area;
    // Add an eighth of the rounding for the vertices of the triangle.
    const double depth = (beneath > 0 ? beneath : 0) + rounding / 8;
    burial_m[i] = static_cast<float>(depth / (sine > 1e-9 ? sine : 1e-9));
    packet.active[i] = toward_sun(p, i, sx, sy, sz) > 0 ? -1 : 0;
  }
}

// Sets toward_moon[i] to 1 if the ray meets a sphere of this radius around the Moon's centre.
void AimAtMoon(const Rays& rays, double radius, std::int64_t* toward_moon) {
  const double radius2 = radius * radius;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double ox = rays.ox[i], oy = rays.oy[i], oz = rays.oz[i];
    const double dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i];
    const double closest = -(ox * dx + oy * dy + oz * dz) / (dx * dx + dy * dy + dz * dz);
    const double px = ox + closest * dx, py = oy + closest * dy, pz = oz + closest * dz;
    toward_moon[i] =
        aims_into_sphere(radius2, ox * ox + oy * oy + oz * oz, px * px + py * py + pz * pz, closest > 0) ? 1 : 0;
  }
}

// Sets facing[i] to 1 if the facet faces the Sun and the interior of the Moon is not in between.
void FaceTheSun(const SurfacePoints& p, const Vec3& sun, std::int32_t* facing) {
  const double sx = sun.x();
  const double sy = sun.y();
  const double sz = sun.z();
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) facing[i] = toward_sun(p, i, sx, sy, sz) > 0 ? 1 : 0;
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(ClipToShell);
HWY_EXPORT(StartShadowRays);
HWY_EXPORT(AimAtMoon);
HWY_EXPORT(FaceTheSun);

// Retries rays that are lost although they point at the Moon: the ROBUST grids of Embree lose about one in 3000 rays
// that pass exactly through an edge or a vertex. Each gets four attempts, shifted by its own rounding error. The point
// itself is computed in double from the unshifted ray.
void retry_lost_rays(const Scene& scene, const Rays& rays, const RayPacket& packet, SurfacePoints& points,
                     Facets& facets) {
  float farthest = 0;  // largest coordinate, m: rounding errors are proportional to it
  for (int i = 0; i < kPacket; ++i)
    if (packet.active[i])
      farthest = std::max({farthest, std::abs(packet.ox[i]), std::abs(packet.oy[i]), std::abs(packet.oz[i])});
  bool found = false;
  for (int attempt = 0; attempt < 4; ++attempt) {
    RayPacket shifted = packet;
    bool is_any_lost = false;
    for (int i = 0; i < kPacket; ++i) {
      shifted.active[i] = points.toward_moon[i] && packet.active[i] ? -1 : 0;
      if (!shifted.active[i]) continue;
      is_any_lost = true;
      const Vec3 d = rays.direction(i).normalized(), sideways = any_across(d);
      const Vec3 shift = static_cast<double>(farthest) * 0x1p-21 * (attempt < 2 ? sideways : d.cross(sideways)) *
                         (attempt % 2 ? -1 : 1);
      shifted.ox[i] += static_cast<float>(shift.x());
      shifted.oy[i] += static_cast<float>(shift.y());
      shifted.oz[i] += static_cast<float>(shift.z());
    }
    if (!is_any_lost) break;
    SurfacePoints retry_points;
    Facets retry_facets;
    scene.tracer->intersect(shifted, retry_points);
    refine(scene.mesh, rays, retry_points, retry_facets);
    for (int i = 0; i < kPacket; ++i) {
      if (!shifted.active[i] || !retry_points.hit[i]) continue;
      found = true;
      points.x[i] = retry_points.x[i];
      points.y[i] = retry_points.y[i];
      points.z[i] = retry_points.z[i];
      points.distance[i] = retry_points.distance[i];
      points.v[i] = retry_points.v[i];
      points.w[i] = retry_points.w[i];
      points.nx[i] = retry_points.nx[i];
      points.ny[i] = retry_points.ny[i];
      points.nz[i] = retry_points.nz[i];
      points.triangle[i] = retry_points.triangle[i];
      points.hit[i] = true;
      points.toward_moon[i] = false;
    }
  }
  if (found) gather(scene.mesh, points.triangle, facets);
}

// Clips the rays to the shell, lets Embree find triangles, refines the points, and retries rays that Embree lost.
void trace(const Scene& scene, const Rays& rays, SurfacePoints& points, Facets& facets) {
  RayPacket packet;
  alignas(64) std::int32_t toward_moon[kPacket];
  HWY_DYNAMIC_DISPATCH(ClipToShell)(rays, scene.shell_m, scene.core_m, scene.anchor, packet, toward_moon);
  bool any = false;
  for (int i = 0; i < kPacket; ++i) {
    if (!rays.valid[i]) packet.active[i] = 0;
    any |= packet.active[i] != 0;
    points.hit[i] = points.toward_moon[i] = false;
  }
  if (any) {
    scene.tracer->intersect(packet, points);
    if (std::find(points.hit, points.hit + kPacket, true) != points.hit + kPacket)
      refine(scene.mesh, rays, points, facets);
  }
  int hits = 0, misses = 0, active = 0;
  for (int i = 0; i < kPacket; ++i) {
    active += packet.active[i] != 0;
    hits += points.hit[i];
    if (!rays.valid[i] || points.hit[i]) continue;
    points.toward_moon[i] = toward_moon[i] != 0;
    misses += points.toward_moon[i];
  }
  // A packet without any hit most likely looks at a void: do not retry it.
  if (misses > 0 && active > 0 && (hits > 0 || active < kPacket)) retry_lost_rays(scene, rays, packet, points, facets);
}

void find_missing(const Scene& scene, const Rays& rays, SurfacePoints& points) {
  alignas(64) std::int64_t toward_moon[kPacket];
  HWY_DYNAMIC_DISPATCH(AimAtMoon)(rays, scene.core_m, toward_moon);
  for (int i = 0; i < kPacket; ++i) points.toward_moon[i] = rays.valid[i] && !points.hit[i] && toward_moon[i];
}

void facing_sun(const SurfacePoints& points, const Vec3& sun, std::int32_t* facing) {
  HWY_DYNAMIC_DISPATCH(FaceTheSun)(points, sun, facing);
}

void sunlit(const Scene& scene, const SurfacePoints& points, const bool* requested, const Vec3& sun, float* lit) {
  RayPacket packet;
  alignas(64) float rounding_m[kPacket];
  alignas(64) float burial_m[kPacket];
  HWY_DYNAMIC_DISPATCH(StartShadowRays)(points, scene.anchor, sun, packet, rounding_m, burial_m);
  bool any = false;
  float largest_m = 0;  // largest rounding error of the packet
  for (int i = 0; i < kPacket; ++i) {
    lit[i] = 0;
    if (!requested[i]) packet.active[i] = 0;
    if (!packet.active[i]) continue;
    any = true;
    largest_m = std::max(largest_m, rounding_m[i]);
  }
  if (!any) return;
  bool blocked[kPacket];
  scene.tracer->occluded(packet, sun, largest_m, burial_m, blocked);
  for (int i = 0; i < kPacket; ++i) lit[i] = packet.active[i] && !blocked[i] ? 1.F : 0.F;
}

std::uint32_t shaded(const Scene& scene, const SurfacePoints& points, std::uint32_t requested_lanes, const Vec3& sun) {
  bool requested[kPacket];
  float lit[kPacket];
  for (int i = 0; i < kPacket; ++i) requested[i] = requested_lanes >> i & 1;
  sunlit(scene, points, requested, sun, lit);
  std::uint32_t out = 0;
  for (int i = 0; i < kPacket; ++i) out |= requested[i] && !(lit[i] > 0) ? 1U << i : 0U;
  return out;
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
