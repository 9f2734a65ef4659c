// Blocks of levels finer than the posts.
#pragma once

#include <cstdint>
#include <limits>
#include <memory>

#include "dem/grid/block.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Vertex of a finer lattice on a block's triangles.
struct InterpolatedVertex {
  double height_m = std::numeric_limits<double>::quiet_NaN();  // NaN: no data
  Vec3 normal = Vec3::zero();                                  // of any length
  SourceMark source = kNoSource;                               // of the nearest corner of the quad, like the ground
  Ground ground = Ground::dem;
  std::uint16_t brightness = kBrightnessOfOne;
};
// Interpolates a block in latitude, longitude and height, at ticks inside it that may be fractional.
InterpolatedVertex interpolate(const Block& block, double lat_tick, double lon_tick);

// Returns a block of a finer level, interpolated on the coarse block's triangles in latitude, longitude and height: the
// surface stays the same but follows the sphere. Beside a pole, where steps of longitude do not halve, quads become
// ruled surfaces. Null if it has no valid post.
std::shared_ptr<const Block> subdivided(const Block& coarse, const BlockId& id);

}  // namespace selenograph::dem
