// Computes rows of vertices from the angles and heights of their posts, vectorised.
#pragma once

#include "engine/scene/mesh.h"

namespace selenograph::engine {

// Sine and cosine of a row's latitude and of its columns' longitudes.
struct RowAngles {
  double cos_lat, sin_lat;
  const double *cos_lon, *sin_lon;
};

// Computes the coordinates of `n` vertices relative to the anchor, MOON_ME, m, rounded once; equal to
// MeshBlock::vertex() for vertices that have not collapsed.
void place_row(const dem::Vertex* row, int n, const RowAngles& angles, const Vec3& anchor_m, float* x, float* y,
               float* z);

// A row of vertices in local axes at a position among them, m; float suffices for bounds. NaN without data.
struct LocalRow {
  static constexpr int kMaxColumns = 96;  // columns of a block plus one vector
  alignas(64) float east[kMaxColumns];
  alignas(64) float north[kMaxColumns];
  alignas(64) float up[kMaxColumns];
  void set(int column, const Vec3& local) {
    east[column] = static_cast<float>(local.x());
    north[column] = static_cast<float>(local.y());
    up[column] = static_cast<float>(local.z());
  }
};
// Computes a row of vertices in local axes. It ignores that vertices may have collapsed.
void local_row(const dem::Vertex* row, int n, const RowAngles& angles, const Vec3& origin_m, const EastNorthUp& axes,
               LocalRow& out);

// Bounds of rows of vertices and of the triangles between them. Vertices without data do not count.
struct LocalBounds {
  LocalBounds();
  void extend(const LocalRow& row, int n);
  void extend(const LocalRow& south, const LocalRow& north, int quads);

  bool empty() const { return !(low[0] <= high[0]); }
  float low[3], high[3];  // along east, north, up
  // Steepest rise of any triangle toward east, north-east, north, north-west ...; infinite for a vertical triangle.
  float steepest[8];
};

}  // namespace selenograph::engine
