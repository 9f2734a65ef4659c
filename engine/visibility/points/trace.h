// Exact ray queries on a scene: the shell is entered in double, float finds the triangle, double finds the point.
#pragma once

#include <cmath>

#include "engine/visibility/points/refine.h"
#include "engine/visibility/points/scene.h"

namespace selenograph::engine {

// Returns a unit vector normal to a unit vector.
inline Vec3 any_across(const Vec3& d) {
  return (std::abs(d.z()) < 0.9 ? Vec3::unit_z() : Vec3::unit_x()).cross(d).normalized();
}

// Finds the first intersection of each valid ray with the surface. `facets`: the triangles there, if any ray hits.
void trace(const Scene& scene, const Rays& rays, SurfacePoints& points, Facets& facets);
inline void trace(const Scene& scene, const Rays& rays, SurfacePoints& points) {
  Facets facets;
  trace(scene, rays, points, facets);
}

// Sets `toward_moon` of the valid rays without a hit.
void find_missing(const Scene& scene, const Rays& rays, SurfacePoints& points);

// Sets facing[i] to 1 if the triangle of the point faces the Sun and the interior of the Moon (below all relief) does
// not hide it, else to 0.
void facing_sun(const SurfacePoints& points, const Vec3& sun, std::int32_t facing[kPacket]);

// Sets lit[i] to 1 if the centre of the Sun is visible from a requested point, else to 0. Facets turned away from the
// Sun are unlit without a shadow ray.
void sunlit(const Scene& scene, const SurfacePoints& points, const bool* requested, const Vec3& sun, float* lit);

// Returns the requested lanes that are in shadow for that direction of the Sun, one bit each.
std::uint32_t shaded(const Scene& scene, const SurfacePoints& points, std::uint32_t requested_lanes, const Vec3& sun);

}  // namespace selenograph::engine
