// What a tile's light reflects to the viewer, at its posts.
#pragma once

#include <span>

#include "engine/indirect/light_tile.h"
#include "engine/radiometry/brdf.h"

namespace selenograph::engine {

// The mean reflectance of the light that arrives in sectors, over that of light from one direction with the same
// irradiance and mean cosine of incidence; 1 where there is none. Of some rows of a tile of the field.
void set_factors(const LightTile& light, const FieldPlane& plane, const TileRows& rows, const Vec3& eye_m,
                 const Brdf& brdf, std::span<float> factors);

}  // namespace selenograph::engine
