// A triangle mesh that isn't terrain, as its file says: corners, triangles and which part of the object each is of.
// mesh_reader.h reads one.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// In the file's own units.
struct ObjectCorner {
  Eigen::Vector3f place;   // from ObjectShape::origin
  Eigen::Vector3f normal;  // for shading; zero: the facet's
};

struct ObjectTriangle {
  std::array<std::uint32_t, 3> corner;  // of ObjectShape::corners
  std::uint32_t part;                   // of ObjectShape::parts
};

struct ObjectShape {
  std::vector<ObjectCorner> corners;
  std::vector<ObjectTriangle> triangles;
  std::vector<std::string> parts;  // the file's materials by name; at least one
  Vec3 origin = Vec3::Zero();      // in the file's coordinates: near the corners, so that float has room for them
  double rounding = 0;             // of the numbers in the file, where it holds no more than float
  bool textured = false;           // it has textures, which nothing is made of

  // In the file's coordinates.
  Vec3 place(const ObjectCorner& corner) const { return origin + corner.place.cast<double>(); }
  Vec3 place(const ObjectTriangle& t, int k) const { return place(corners[t.corner[static_cast<std::size_t>(k)]]); }
  std::size_t bytes() const {
    return corners.size() * sizeof(ObjectCorner) + triangles.size() * sizeof(ObjectTriangle);
  }
};

}  // namespace selenograph::engine
