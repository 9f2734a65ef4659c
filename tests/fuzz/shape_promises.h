// What holds for every shape that a frame is made with.
#pragma once

#include "engine/scene/object_shape.h"
#include "engine/support/utf8.h"
#include "tests/fuzz/fuzz.h"

namespace selenograph::fuzz {

inline void check_shape(const engine::ObjectShape& shape) {
  require(!shape.triangles.empty() && !shape.parts.empty(), "a shape has a triangle and a part");
  for (const engine::ObjectCorner& corner : shape.corners) {
    require(corner.place.allFinite(), "corners are finite");
    const float length = corner.normal.norm();
    require(length == 0 || std::abs(length - 1) < 1e-3F, "normals are unit or zero");
  }
  for (const engine::ObjectTriangle& t : shape.triangles) {
    for (const std::uint32_t corner : t.corner) require(corner < shape.corners.size(), "corners are there");
    require(t.part < shape.parts.size(), "parts are there");
  }
  for (const std::string& part : shape.parts) require(engine::is_utf8(part), "names are UTF-8");
}

}  // namespace selenograph::fuzz
