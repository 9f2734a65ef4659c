// Rays against a scene, exactly: the shell is entered in double, float finds the triangle, double finds the point.
#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include "engine/visibility/points/refine.h"
#include "engine/visibility/points/scene.h"

namespace selenograph::engine {

// A unit vector across a unit vector.
inline Vec3 any_across(const Vec3& d) {
  return (std::abs(d.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitX()).cross(d).normalized();
}

// Where each valid ray first meets the surface; `facets`: the triangles there, if any is hit.
void trace(const Scene& scene, const Rays& rays, SurfacePoints& points, Facets& facets);
inline void trace(const Scene& scene, const Rays& rays, SurfacePoints& points) {
  Facets facets;
  trace(scene, rays, points, facets);
}

// Sets `toward_moon` of the valid rays without a hit.
void find_missing(const Rays& rays, SurfacePoints& points);

// facing[i]: 1 where a point's triangle faces the Sun and the Moon's inside (below all relief) isn't in between, else
// 0.
void facing_sun(const SurfacePoints& points, const Vec3& sun, std::int32_t facing[kPacket]);

// Fraction 0 or 1 for each wanted point: does the Sun's centre reach it. Back-facing facets
// are unlit; no shadow ray is cast from them.
void sunlit(const Scene& scene, const SurfacePoints& points, const bool* wanted, const Vec3& sun, float* lit);

// Of the points that ask, those that no Sun comes to from that direction: a bit each.
std::uint32_t shaded(const Scene& scene, const SurfacePoints& points, std::uint32_t asking, const Vec3& sun);

}  // namespace selenograph::engine
