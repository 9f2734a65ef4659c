// Reflectance of the light from many directions at a tile's posts, relative to light from one direction.
#pragma once

#include <optional>
#include <span>

#include "engine/camera/row_views.h"
#include "engine/indirect/light_tile.h"
#include "engine/radiometry/brdf.h"

namespace selenograph::engine {

// Position from which the ground is viewed: one point, or the cameras of views, each for the rows that it images.
struct Viewer {
  const RowViews& views;
  std::optional<Vec3> eye_m;
  bool varies() const { return !eye_m && views.vary(); }
  Vec3 eye_for(const Vec3& ground_m) const { return eye_m ? *eye_m : views.camera_seeing(ground_m); }
};

// Sets factors for some rows of a tile: the mean reflectance of the light from all sectors, over that of light from one
// direction with the same irradiance and mean cosine of incidence; 1 without light.
void set_factors(const LightTile& light, const FieldPlane& plane, const TileRows& rows, const Viewer& viewer,
                 const Brdf& brdf, std::span<float> factors);

}  // namespace selenograph::engine
