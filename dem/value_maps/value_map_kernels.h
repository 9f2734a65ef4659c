// Vectorised means of many small footprints on one tile of a map.
#pragma once

#include <cstddef>
#include <cstdint>

namespace selenograph::dem {

// Side, in texels, of the tiles of a map's level 0.
inline constexpr int kMapTile = 128;

// Footprints as in ValueMap::Footprint2, as structure of arrays. Some entries may be undefined.
inline constexpr std::size_t kFootprints = 16;
struct Footprints {
  const double *lat_deg, *lon_deg, *cos_lat;
  const double *a_east_m, *a_north_m, *b_east_m, *b_north_m;
};

// A tile of a map's level 0: position of its first texel's centre, and its size in texels.
struct MapTile {
  const float* texels;
  double west_deg, north_deg;  // that centre; its longitude is within the same turn as the footprints'
  double per_deg_east, per_deg_south;
  int columns, rows;
};

// Computes the mean of each footprint whose sides are no longer than a texel and whose probes lie between valid texels
// of the tile. Returns one bit per footprint that has a mean, bit 0 for the first; other `values` are undefined.
//
//   +---------+---------+    corners: centres of texels. Within such a square the map is bilinear:
//   |  /--/   |         |    value = c0 + cx u + cy v + cxy u v. The mean over a parallelogram inside one square is
//   | /--/    |   /--/  |    the value at its centre plus cxy times the mean of u v about the centre (the twist).
//   |         |  /--/   |
//   +---------+-/--/----+    A requested footprint across squares gets the mean of four probes instead.
std::uint32_t small_means(const MapTile& tile, const Footprints& footprints, std::uint32_t requested, double* values);

}  // namespace selenograph::dem
