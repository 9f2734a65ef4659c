// Light of a tile reflected to the viewer, at its posts.
#pragma once

#include <optional>
#include <span>

#include "engine/camera/row_views.h"
#include "engine/indirect/light_tile.h"
#include "engine/radiometry/brdf.h"

namespace selenograph::engine {

// Who looks at the ground: a place, or the cameras of views, each at what it sees.
struct Viewer {
  const RowViews& views;
  std::optional<Vec3> place_m;
  bool varies() const { return !place_m && views.vary(); }
  Vec3 looking_at(const Vec3& ground_m) const { return place_m ? *place_m : views.camera_seeing(ground_m); }
};

// The mean reflectance of the light that arrives in sectors, over that of light from one direction with the same
// irradiance and mean cosine of incidence; 1 where there is none. Of some rows of a tile of the field.
void set_factors(const LightTile& light, const FieldPlane& plane, const TileRows& rows, const Viewer& viewer,
                 const Brdf& brdf, std::span<float> factors);

}  // namespace selenograph::engine
