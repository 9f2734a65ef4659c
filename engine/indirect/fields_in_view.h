// Which posts of indirect light a frame sees.
#pragma once

#include <span>
#include <vector>

#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/indirect/light_field.h"
#include "engine/scene/mesh.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// Ground of pixels larger than this gets no indirect light: at that scale slopes see little of each other.
inline constexpr double kLargestLitPixel_m = 240;

struct ViewOfGround {
  const RowViews& views;
  const Mesh& mesh;
  std::span<const Ball> objects;  // which the ground below them lights
};

struct FieldsInView {
  struct Field {
    LightField id;
    FieldPlane plane;
    std::vector<TileRows> tiles;  // ascending: what may be seen, and what is below objects that may
  };
  std::vector<Field> fields;
  std::vector<int> of_block;  // per block of the mesh; -1: none
  std::size_t tiles() const;
};

// `spacing_px`: IndirectLight's. Parallel.
FieldsInView fields_in_view(const ViewOfGround& view, const dem::Terrain& terrain, double spacing_px);

}  // namespace selenograph::engine
