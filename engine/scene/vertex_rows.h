// Rows of vertices from the angles and heights of their posts, for every vector width.
#pragma once

#include "engine/scene/mesh.h"

namespace selenograph::engine {

// A row's latitude and its columns' longitudes.
struct RowPlace {
  double cos_lat, sin_lat;
  const double *cos_lon, *sin_lon;
};

// x, y, z: `n` vertices, MOON_ME relative to the anchor, metres, rounded once. What MeshBlock::vertex() says of
// vertices that have not collapsed.
void place_row(const MeshVertex* row, int n, const RowPlace& place, const Vec3& anchor_m, float* x, float* y, float* z);

}  // namespace selenograph::engine
