// The posts of indirect light that a frame needs.
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

// Ground in pixels larger than this gets no light from terrain: its posts would be as far apart as craters are wide. In
// pixels of up to half this size it gets all, in between a share.
inline constexpr double kLargestLitPixel_m = 1000;

// Share of the light from terrain by distance from the camera: 1 up to begins_m, 0 from ends_m.
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
  std::span<const Ball> objects, rocks;  // bounding spheres of what the ground below lights
};

struct FieldsInView {
  struct Field {
    LightField id;
    FieldPlane plane;
    std::vector<TileRows> tiles;  // tiles in view and below objects in view, ascending
  };
  std::vector<Field> fields;
  std::vector<int> field_of_block;   // index in `fields` per block of the mesh; -1: none
  std::vector<int> field_of_object;  // index of the field below each object's middle; -1: the object is culled or the
                                     // light has faded out
  std::optional<Fade> fade;          // empty if all ground in view is nearer than begins_m
  std::size_t tiles() const;
};

// Finds the fields and tiles of a frame, in parallel. `spacing_px`: IndirectLight's.
FieldsInView fields_in_view(const ViewOfGround& view, const dem::Terrain& terrain, double spacing_px);

}  // namespace selenograph::engine
