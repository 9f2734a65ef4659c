// Refines hits from a triangle, found in float, to the exact point in double, sixteen rays at a time.
#pragma once

#include "engine/support/packet.h"
#include "engine/visibility/points/facets.h"

namespace selenograph::engine {

// For lanes with hit[i] and triangle[i]: computes the ray's point on that triangle, or on its neighbour where float
// rounding chose the wrong side of an edge. Clears the hit when the ray meets the surface from below (it came through a
// hole in the data). `facets`: the final triangles of the points.
void refine(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets);

// Whether a place beside a triangle of the mesh is below the surface.
bool buried(const Mesh& mesh, const TriangleId& beside, const Vec3& place);

// The unit shading normal at a point: the vertex normals (dem/grid/shading_normals.h), interpolated. Where that faces
// away from the viewing `direction` although the facet is seen, the facet's normal.
Vec3 shading_normal(const Mesh& mesh, const SurfacePoints& points, int lane, const Vec3& direction);

}  // namespace selenograph::engine
