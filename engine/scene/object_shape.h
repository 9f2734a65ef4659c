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
  Eigen::Vector3f place;
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
  bool textured = false;           // it has textures, which nothing is made of

  Vec3 place(const ObjectTriangle& t, int k) const {
    return corners[t.corner[static_cast<std::size_t>(k)]].place.cast<double>();
  }
  std::size_t bytes() const {
    return corners.size() * sizeof(ObjectCorner) + triangles.size() * sizeof(ObjectTriangle);
  }
};

}  // namespace selenograph::engine
