// From "which triangle" in float to "exactly where" in double, sixteen rays at a time.
#pragma once

#include "engine/support/packet.h"
#include "engine/visibility/points/facets.h"

namespace selenograph::engine {

// Where hit[i] and triangle[i] are set: the ray's point on that triangle, or on its neighbour where float rounding
// chose the wrong side of an edge. Takes the hit back when the ray meets the surface from below (it came through a hole
// in the data).
// `facets`: the triangles that the points are on, at last.
void refine(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets);

// Whether a place next to a triangle of the mesh lies below the surface.
bool buried(const Mesh& mesh, const TriangleId& beside, const Vec3& place);

// The unit normal that shading uses at a point: those of the triangle's vertices (dem/grid/shading_normals.h), weighted
// by its place. Where that leans away from whoever looks along `direction`, who sees the facet all the same: the
// facet's.
Vec3 shading_normal(const Mesh& mesh, const SurfacePoints& points, int lane, const Vec3& direction);

}  // namespace selenograph::engine
