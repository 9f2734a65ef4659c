// A place on a level's surface.
#pragma once

#include <optional>

#include "dem/base/stop_token.h"
#include "dem/grid/geodesy.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

struct SurfacePlace {
  double height_m;
  Vec3 up;  // the surface's normal there, unit, MOON_ME
};

// A place in the lattice's ticks, below the pole's own; and the tick that each is in.
struct Ticks {
  double lat, lon;
  std::int32_t whole_lat, whole_lon;
  BlockId block(int level) const { return block_at(level, whole_lat, whole_lon); }
};

Ticks ticks_of(double lat_deg, double lon_deg);

BlockId block_at_place(int level, double lat_deg, double lon_deg);
// Finest level of the terrain at a place.
int finest_level_at(const Terrain& terrain, double lat_deg, double lon_deg);

// Place on a block's triangles; the block contains it. Empty where a post is missing.
std::optional<SurfacePlace> surface_on(const Block& block, double lat_deg, double lon_deg);
// Place on the triangles of a level, or of the finest level there; empty where a post is missing.
std::optional<SurfacePlace> surface_at(const Terrain& terrain, double lat_deg, double lon_deg, int level,
                                       const StopToken& stop = {});

}  // namespace selenograph::dem
