// Rows of vertices from the angles and heights of their posts, for every vector width.
#pragma once

#include <array>

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

// The box of vertices along the axes of a place. Those without data don't count.
class BoxAlong {
 public:
  BoxAlong(const Vec3& origin_m, const EastNorthUp& axes);
  void extend(const MeshVertex* row, int n, const RowPlace& place);  // as if none had collapsed
  void extend(const Vec3& vertex_m);

  bool empty() const { return !(low_[0] <= high_[0]); }
  Vec3 low() const { return Vec3(low_.data()); }  // along east, north, up
  Vec3 high() const { return Vec3(high_.data()); }

 private:
  Vec3 origin_;
  std::array<Vec3, 3> axes_;
  std::array<double, 3> low_, high_;
};

}  // namespace selenograph::engine
