#include "engine/trace.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "engine/vectorise.h"

namespace selenograph::engine {
namespace {

constexpr double kLattice_m = 4096;

// Distance (in the direction's lengths) at which a ray enters the sphere; 0 from inside, empty when it misses or leaves.
std::optional<double> enter_sphere(const Vec3& origin, const Vec3& direction, double radius) {
  const double outside = origin.squaredNorm() - radius * radius;
  if (outside <= 0) return 0.0;
  const double a = direction.squaredNorm(), b = origin.dot(direction);
  const double root2 = b * b - a * outside;
  if (b >= 0 || root2 < 0) return std::nullopt;
  return outside / (-b + std::sqrt(root2));  // the stable form of the nearer root
}

// Per lane: entry into the sphere (or the start, inside of it), relative to the anchor, in float. `active` where there is one.
SELENOGRAPH_VECTORISED
void start_rays(const Rays& rays, double radius, double ax, double ay, double az, RayPacket& packet) {
  const double radius2 = radius * radius;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double ox = rays.ox[i], oy = rays.oy[i], oz = rays.oz[i], dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i];
    const double outside = ox * ox + oy * oy + oz * oz - radius2;
    const double a = dx * dx + dy * dy + dz * dz, b = ox * dx + oy * dy + oz * dz, root2 = b * b - a * outside;
    const double entry = outside / (-b + std::sqrt(root2 > 0 ? root2 : 0));  // the stable form of the nearer root
    const bool inside = outside <= 0, meets = inside || (b < 0 && root2 >= 0);
    const double t = inside || !meets ? 0 : entry;
    packet.ox[i] = static_cast<float>(ox + t * dx - ax), packet.oy[i] = static_cast<float>(oy + t * dy - ay), packet.oz[i] = static_cast<float>(oz + t * dz - az);
    packet.dx[i] = static_cast<float>(dx), packet.dy[i] = static_cast<float>(dy), packet.dz[i] = static_cast<float>(dz);
    packet.active[i] = meets ? -1 : 0;
  }
}

// Whether the solid inside of the Moon (below all relief) stands between a point and the Sun.
bool behind_core(const Vec3& p, const Vec3& sun) {
  constexpr double kCore = kMoonRadius_m + dem::kLowestRelief_m;
  const double b = p.dot(sun);
  return b < 0 && p.squaredNorm() - b * b < kCore * kCore;
}

}  // namespace

Vec3 anchor_for(const Vec3& camera_m, const Vec3& boresight) {
  const double distance = camera_m.norm();
  Vec3 near = camera_m * (kMoonRadius_m / distance);
  if (distance > 1.2 * kMoonRadius_m)
    if (const auto t = enter_sphere(camera_m, boresight, kMoonRadius_m)) near = camera_m + *t * boresight;
  return (near / kLattice_m).array().round() * kLattice_m;
}

void trace(const Scene& scene, const Rays& rays, SurfacePoints& points) {
  RayPacket packet;
  const Vec3& anchor = scene.tracer.anchor();
  start_rays(rays, scene.shell_m, anchor.x(), anchor.y(), anchor.z(), packet);
  bool any = false;
  for (int i = 0; i < kPacket; ++i) {
    if (!rays.valid[i]) packet.active[i] = 0;
    any |= packet.active[i] != 0;
    points.hit[i] = points.toward_moon[i] = false;
  }
  if (any) {
    scene.tracer.intersect(packet, points);
    refine(scene.mesh, rays, points);
  }
  for (int i = 0; i < kPacket; ++i)
    if (rays.valid[i] && !points.hit[i]) points.toward_moon[i] = enter_sphere(rays.origin(i), rays.direction(i), kMoonRadius_m).has_value();
}

void sunlit(const Scene& scene, const SurfacePoints& points, const bool* wanted, const Vec3& sun, float* lit) {
  RayPacket packet;
  const Vec3& anchor = scene.tracer.anchor();
  const float sx = static_cast<float>(sun.x()), sy = static_cast<float>(sun.y()), sz = static_cast<float>(sun.z());
  bool any = false;
  float farthest = 0;
  for (int i = 0; i < kPacket; ++i) {
    lit[i] = 0;
    const bool ask = wanted[i] && points.facing(i).dot(sun) > 0 && !behind_core(points.position(i), sun);
    packet.active[i] = ask ? -1 : 0;
    packet.ox[i] = ask ? static_cast<float>(points.x[i] - anchor.x()) : 0, packet.oy[i] = ask ? static_cast<float>(points.y[i] - anchor.y()) : 0;
    packet.oz[i] = ask ? static_cast<float>(points.z[i] - anchor.z()) : 0;
    packet.dx[i] = sx, packet.dy[i] = sy, packet.dz[i] = sz;
    farthest = std::max({farthest, std::abs(packet.ox[i]), std::abs(packet.oy[i]), std::abs(packet.oz[i])});
    any |= ask;
  }
  if (!any) return;
  // Within the coordinates' own rounding lies only the surface that the ray leaves: no need to have it found and dropped again.
  packet.near = farthest * 0x1p-22F;
  bool blocked[kPacket];
  scene.tracer.occluded(packet, sun, blocked);
  for (int i = 0; i < kPacket; ++i) lit[i] = packet.active[i] && !blocked[i] ? 1.F : 0.F;
}

void sunlit_disc(const Scene& scene, const SurfacePoints& points, const bool* wanted, const Vec3& sun, double angular_radius_rad, float* lit) {
  const Vec3 across = (std::abs(sun.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitX()).cross(sun).normalized(), up = sun.cross(across);
  float sum[kPacket] = {};
  for (int k = 0; k < kDiscSamples; ++k) {
    // Vogel's sunflower (1979): equal areas, no two samples in line with a straight shadow edge.
    const double r = angular_radius_rad * std::sqrt((k + 0.5) / kDiscSamples), turn = k * std::numbers::pi * (3 - std::sqrt(5.0));
    const Vec3 toward = (sun + std::tan(r) * (std::cos(turn) * across + std::sin(turn) * up)).normalized();
    float one[kPacket];
    sunlit(scene, points, wanted, toward, one);
    for (int i = 0; i < kPacket; ++i) sum[i] += one[i];
  }
  for (int i = 0; i < kPacket; ++i) lit[i] = sum[i] / kDiscSamples;
}

}  // namespace selenograph::engine
