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
void place_row(const dem::Vertex* row, int n, const RowPlace& place, const Vec3& anchor_m, float* x, float* y,
               float* z);

// A row of vertices along the axes of a place among them, metres; float is enough for bounds. NaN: no data.
struct LocalRow {
  static constexpr int kMost = 96;  // a block's columns, and a vector more
  alignas(64) float east[kMost], north[kMost], up[kMost];
  void set(int column, const Vec3& local) {
    east[column] = static_cast<float>(local.x()), north[column] = static_cast<float>(local.y()),
    up[column] = static_cast<float>(local.z());
  }
};
// As if none had collapsed.
void local_row(const dem::Vertex* row, int n, const RowPlace& place, const Vec3& origin_m, const EastNorthUp& axes,
               LocalRow& out);

// Bounds over rows of vertices and the triangles between them. What has no data doesn't count.
struct LocalBounds {
  LocalBounds();
  void extend(const LocalRow& row, int n);
  void extend(const LocalRow& south, const LocalRow& north, int quads);

  bool empty() const { return !(low[0] <= high[0]); }
  float low[3], high[3];  // along east, north, up
  // The steepest rise of any triangle toward east, north-east, north, north-west ...; infinite where one stands
  // upright.
  float steepest[8];
};

}  // namespace selenograph::engine
