// Computes rows of vertices from the angles and heights of their posts, vectorised.
#pragma once

#include "engine/scene/mesh.h"

namespace selenograph::engine {

// Latitude of a row and longitudes of its columns.
struct RowPlace {
  double cos_lat, sin_lat;
  const double *cos_lon, *sin_lon;
};

// Computes `n` vertices x, y, z, MOON_ME relative to the anchor, metres, rounded once; equal to MeshBlock::vertex() for
// vertices that have not collapsed.
void place_row(const dem::Vertex* row, int n, const RowPlace& place, const Vec3& anchor_m, float* x, float* y,
               float* z);

// A row of vertices in the local axes of a place among them, metres; float is enough for bounds. NaN: no data.
struct LocalRow {
  static constexpr int kMost = 96;  // columns of a block plus one vector
  alignas(64) float east[kMost], north[kMost], up[kMost];
  void set(int column, const Vec3& local) {
    east[column] = static_cast<float>(local.x());
    north[column] = static_cast<float>(local.y());
    up[column] = static_cast<float>(local.z());
  }
};
// Ignores collapsed vertices.
void local_row(const dem::Vertex* row, int n, const RowPlace& place, const Vec3& origin_m, const EastNorthUp& axes,
               LocalRow& out);

// Bounds over rows of vertices and the triangles between them. No-data is ignored.
struct LocalBounds {
  LocalBounds();
  void extend(const LocalRow& row, int n);
  void extend(const LocalRow& south, const LocalRow& north, int quads);

  bool empty() const { return !(low[0] <= high[0]); }
  float low[3], high[3];  // along east, north, up
  // Steepest rise of any triangle toward east, north-east, north, north-west ...; infinite for a vertical one.
  float steepest[8];
};

}  // namespace selenograph::engine
