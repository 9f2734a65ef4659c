// A place on a level's surface.
#pragma once

#include <optional>

#include "dem/grid/geodesy.h"
#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

struct SurfacePlace {
  double height_m;
  Vec3 up;  // the surface's normal there, unit, MOON_ME
};

BlockId block_at_place(int level, double lat_deg, double lon_deg);
// The finest level that the terrain has at a place.
int finest_level_at(const Terrain& terrain, double lat_deg, double lon_deg);

// On the triangles of a level, or of the finest that there is; nothing where one of the posts is missing.
std::optional<SurfacePlace> surface_at(const Terrain& terrain, double lat_deg, double lon_deg, int level,
                                       const StopToken& stop = {});

}  // namespace selenograph::dem
