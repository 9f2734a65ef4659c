// Triangle mesh of an object, as read from its file (mesh_reader.h): corners, triangles, and the material of each.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// Coordinates in the file's units.
struct ObjectCorner {
  Vec3f place;
  Vec3f normal;  // shading normal; zero: use the facet's normal
};

struct ObjectTriangle {
  std::array<std::uint32_t, 3> corner;  // indices into ObjectShape::corners
  std::uint32_t part;                   // index into ObjectShape::parts
};

struct ObjectShape {
  std::vector<ObjectCorner> corners;
  std::vector<ObjectTriangle> triangles;
  std::vector<std::string> parts;  // names of the file's materials; at least one
  bool textured = false;           // the file has textures, which are ignored

  Vec3 place(const ObjectTriangle& t, int k) const {
    return corners[t.corner[static_cast<std::size_t>(k)]].place.cast<double>();
  }
  std::size_t bytes() const {
    return corners.size() * sizeof(ObjectCorner) + triangles.size() * sizeof(ObjectTriangle);
  }
};

}  // namespace selenograph::engine
