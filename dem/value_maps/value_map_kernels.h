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
  double west_deg, north_deg;  // of that centre; the longitude is in the same turn as the footprints'
  double per_deg_east, per_deg_south;
  int columns, rows;
};

// Computes the mean of each footprint that is smaller than a texel and between the centres of four valid texels of the
// tile: the map is bilinear there, and the mean is the value at the centre plus the xy term. Returns one bit per such
// footprint, the first the lowest; other `values` are undefined.
std::uint32_t means_within_texels(const MapTile& tile, const Footprints& footprints, double* values);

}  // namespace selenograph::dem
