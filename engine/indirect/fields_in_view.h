// Which posts of indirect light a frame sees.
#pragma once

#include <vector>

#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/indirect/light_field.h"
#include "engine/scene/mesh.h"

namespace selenograph::engine {

// Ground of pixels larger than this gets no indirect light: at that scale slopes see little of each other.
inline constexpr double kLargestLitPixel_m = 240;

struct FieldsInView {
  struct Field {
    LightField id;
    FieldPlane plane;
    std::vector<int> tiles;  // row * plane.tiles() + column, ascending: those that may be seen
  };
  std::vector<Field> fields;
  std::vector<int> of_block;  // per block of the mesh; -1: none
  std::size_t tiles() const;
};

// `spacing_px`: distance of posts in the image, but at least that of the terrain's. Parallel.
FieldsInView fields_in_view(const Mesh& mesh, const RowViews& views, const dem::Terrain& terrain, double spacing_px);

}  // namespace selenograph::engine
