// Refines hits from a triangle, found in float, to the exact point in double, sixteen rays at a time.
#pragma once

#include "engine/support/packet.h"
#include "engine/visibility/points/facets.h"

namespace selenograph::engine {

// Barycentric distances up to which a ray that hits no triangle counts as hitting the one that was found: by the
// rounding of float, millimetres; and where rows have their own times, because edges between vertices of different
// times are straight.
inline constexpr double kMaxMiss = 1e-3, kMaxMissOfRows = 1e-2;

// For lanes with hit[i] and triangle[i]: computes the point of the ray on that triangle, or on its neighbour if float
// rounding chose the wrong side of an edge. Clears the hit if the ray reaches the surface from below, through a hole in
// the data. `facets`: the final triangles of the points.
void refine(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets, double max_miss = kMaxMiss);

// Returns whether a point next to the triangle `nearby` of the mesh is below the surface.
bool buried(const Mesh& mesh, const TriangleId& nearby, const Vec3& point);

// Returns the unit shading normal at a point: the vertex normals (dem/grid/shading_normals.h), interpolated; or the
// normal of the facet if the interpolated one faces away from the viewing `direction`.
Vec3 shading_normal(const Mesh& mesh, const SurfacePoints& points, int lane, const Vec3& direction);

}  // namespace selenograph::engine
