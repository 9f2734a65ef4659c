// Loops over sixteen pixels of a drawn row: their triangles, and unoccluded light.
#pragma once

#include <cstdint>

#include "engine/support/packet.h"

namespace selenograph::engine {

// Share of a triangle that counts as its edge, where light is computed in double.
inline constexpr double kEdge = 1e-5;

// Sets `hit` and `triangle` from the first `inside` ids, some of which may be kNoTriangle.
void take_triangles(const std::uint32_t* ids, int inside, SurfacePoints& points);

// lit[i]: 1 if the point is hit and both its facet and its shading normal face the Sun, else 0.
void lit_lanes(const SurfacePoints& points, const Shading& shading, const std::int32_t* facing, float* lit);

// Whether all lanes are lit and none is within a share `kEdge` of its triangle's edges.
bool all_lit_inside(const SurfacePoints& points, const float* lit);

}  // namespace selenograph::engine
