// Loops over sixteen pixels of a drawn row: which triangle each has, and whether it is lit as far as it is alone with
// the Sun.
#pragma once

#include <cstdint>

#include "engine/support/packet.h"

namespace selenograph::engine {

// Share of a triangle that counts as its edge, where light is looked at in double.
inline constexpr double kEdge = 1e-5;

// Sets `hit` and `triangle`: the first `inside` of ids, of which some may be kNoTriangle.
void take_triangles(const std::uint32_t* ids, int inside, SurfacePoints& points);

// lit[i]: 1 where the point is hit and it, by its facet and by its shading normal, faces the Sun, else 0.
void lit_lanes(const SurfacePoints& points, const Shading& shading, const std::int32_t* facing, float* lit);

// Whether all lanes are lit, with none within a share `kEdge` of its triangle's edges.
bool all_lit_inside(const SurfacePoints& points, const float* lit);

}  // namespace selenograph::engine
