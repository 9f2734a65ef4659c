// Exact ray queries on a scene: the shell is entered in double, float finds the triangle, double finds the point.
#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include "engine/visibility/points/refine.h"
#include "engine/visibility/points/scene.h"

namespace selenograph::engine {

// A unit vector normal to a unit vector.
inline Vec3 any_across(const Vec3& d) {
  return (std::abs(d.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitX()).cross(d).normalized();
}

// First intersection of each valid ray with the surface; `facets`: the triangles there, if any ray hits.
void trace(const Scene& scene, const Rays& rays, SurfacePoints& points, Facets& facets);
inline void trace(const Scene& scene, const Rays& rays, SurfacePoints& points) {
  Facets facets;
  trace(scene, rays, points, facets);
}

// Sets `toward_moon` of the valid rays without a hit.
void find_missing(const Scene& scene, const Rays& rays, SurfacePoints& points);

// facing[i]: 1 if the point's triangle faces the Sun and the Moon's interior (below all relief) does not hide it, else
// 0.
void facing_sun(const SurfacePoints& points, const Vec3& sun, std::int32_t facing[kPacket]);

// lit[i]: 1 if the Sun's centre reaches a wanted point, else 0. Back-facing facets are unlit; no shadow ray is cast
// from them.
void sunlit(const Scene& scene, const SurfacePoints& points, const bool* wanted, const Vec3& sun, float* lit);

// The asking points that are in shadow for that direction of the Sun, one bit each.
std::uint32_t shaded(const Scene& scene, const SurfacePoints& points, std::uint32_t asking, const Vec3& sun);

}  // namespace selenograph::engine
