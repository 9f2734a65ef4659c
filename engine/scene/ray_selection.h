// Selects the blocks that rays, or bundles of them, need.
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/geodesy.h"
#include "dem/terrain/terrain.h"

namespace selenograph::engine {

// Rays that begin within `radius_m` of a position and lie within an angle of a direction: a single ray, or a bundle.
struct RayCone {
  Vec3 origin_m;
  Vec3 direction;  // unit
  double radius_m = 0;
  double slope = 0;                                       // tangent of the angle
  double to_m = std::numeric_limits<double>::infinity();  // limit along the axis: hits beyond it do not count
  bool is_single_ray() const { return radius_m == 0 && slope == 0; }
};

// Returns the distance along a cone's axis at which all of the cone is below any terrain: all hits are nearer. Infinite
// if there is no such distance, or the cone begins there. Without this limit, a ray into the ground would be followed
// to where it leaves the Moon again.
double range_below_terrain_m(const RayCone& ray);

// Returns the finest blocks that rays may hit, or pass within above_m above, sorted, each with its rays; empty if there
// are more than max_blocks. Blocks with detail are no finer than `finest_detail`. Where sources differ, neighbours may
// differ by more than one level; the mesh stitches them all the same.
// A block and the rays that may hit it.
struct BlockOnRays {
  dem::BlockId id;
  double low_m, high_m;           // height range of its terrain
  std::vector<std::size_t> rays;  // indices of the rays, ascending
};
std::optional<std::vector<BlockOnRays>> select_for_rays(const dem::Terrain& terrain, const std::vector<RayCone>& rays,
                                                        std::size_t max_blocks, const StopToken& stop,
                                                        double above_m = 0, int finest_detail = dem::kMaxLevel);

}  // namespace selenograph::engine
