// What a tile's light reflects towards who looks, at its posts.
#pragma once

#include <array>
#include <span>

#include "engine/indirect/light_field.h"
#include "engine/indirect/light_lanes.h"
#include "engine/radiometry/brdf.h"

namespace selenograph::engine {

struct PostGround {
  Eigen::Vector3f normal;  // unit, MOON_ME; zero: no data
  float height_m;          // NaN: no data
};

// The mean reflectance of the light that arrives in sectors, over that of light from one direction with the same
// irradiance and mean cosine of incidence; 1 where there is none. `tile` of the field, row by row.
void set_factors(std::span<const SectorPost> sectors, std::span<const PostGround> ground, const FieldPlane& plane,
                 int tile, const Vec3& eye_m, const Brdf& brdf, std::span<SumPost> sums);

}  // namespace selenograph::engine
