// Heights and normals at positions on the surface of a level.
#pragma once

#include <optional>

#include "dem/base/stop_token.h"
#include "dem/grid/geodesy.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

struct SurfacePlace {
  double height_m;
  Vec3 up;  // the surface's normal, unit, MOON_ME
};

// A position in ticks of the lattice; latitudes at the north pole are clamped to just below it, where the last blocks
// end.
struct Ticks {
  double lat, lon;
  Tick whole_lat, whole_lon;  // rounded down
  BlockId block(int level) const { return block_at(level, whole_lat, whole_lon); }
};

Ticks ticks_of(double lat_deg, double lon_deg);

BlockId block_at_place(int level, double lat_deg, double lon_deg);
// Returns the finest level of the terrain at a position.
int finest_level_at(const Terrain& terrain, double lat_deg, double lon_deg);

// Returns the point on a block's triangles; the block must contain the position. Empty where a post is missing.
std::optional<SurfacePlace> surface_on(const Block& block, double lat_deg, double lon_deg);
// Returns the point on the triangles of a level, or of the finest level there if that is coarser. Empty where a post is
// missing.
std::optional<SurfacePlace> surface_at(const Terrain& terrain, double lat_deg, double lon_deg, int level,
                                       const StopToken& stop = {});

}  // namespace selenograph::dem
