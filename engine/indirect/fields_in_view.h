// The posts of indirect light that a frame sees.
#pragma once

#include <algorithm>
#include <optional>
#include <span>
#include <vector>

#include "dem/grid/geodesy.h"
#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/indirect/light_field.h"
#include "engine/scene/mesh.h"
#include "engine/scene/selected_blocks.h"

namespace selenograph::engine {

// Ground in pixels larger than this gets no light from terrain: the posts of it would be as wide as craters. Up to half
// as large it gets all, between less and less.
inline constexpr double kLargestLitPixel_m = 1000;

// By the distance from the camera.
struct Fade {
  Vec3 camera_m;
  double begins_m, ends_m;
  double share(const Vec3& place_m) const {
    return std::clamp((ends_m - (place_m - camera_m).norm()) / (ends_m - begins_m), 0.0, 1.0);
  }
};

struct ViewOfGround {
  const RowViews& views;
  const Mesh& mesh;
  std::span<const Ball> objects, rocks;  // which the ground below them lights
};

struct FieldsInView {
  struct Field {
    LightField id;
    FieldPlane plane;
    std::vector<TileRows> tiles;  // ascending: what may be seen, and what is below objects that may
  };
  std::vector<Field> fields;
  std::vector<int> of_block;   // per block of the mesh; -1: none
  std::vector<int> of_object;  // what is below each object's middle; -1: nobody sees the object, or it fades out
  std::optional<Fade> fade;    // empty: nothing in view is so far away
  std::size_t tiles() const;
};

// `spacing_px`: IndirectLight's. Parallel.
FieldsInView fields_in_view(const ViewOfGround& view, const dem::Terrain& terrain, double spacing_px);

}  // namespace selenograph::engine
