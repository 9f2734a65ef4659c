// Loops over sixteen pixels of a drawn row: their triangles, and unoccluded light.
#pragma once

#include <cstdint>

#include "engine/support/packet.h"

namespace selenograph::engine {

// Barycentric width of the edge of a triangle; points there get their light in double.
inline constexpr double kEdge = 1e-5;

// Sets `hit` and `triangle` from the first `inside` ids, some of which may be kNoTriangle.
void take_triangles(const std::uint32_t* ids, int inside, SurfacePoints& points);

// Sets lit[i] to 1 if the point is hit and both its facet and its shading normal face the Sun, else to 0.
void lit_lanes(const SurfacePoints& points, const Shading& shading, const std::int32_t* facing, float* lit);

// Returns whether all lanes are lit and no point is closer to an edge of its triangle than kEdge.
bool all_lit_inside(const SurfacePoints& points, const float* lit);

}  // namespace selenograph::engine
