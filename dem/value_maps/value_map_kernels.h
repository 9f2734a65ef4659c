// Many small footprints on one tile of a map at once, in vectors of whatever width the machine has.
#pragma once

#include <cstddef>
#include <cstdint>

namespace selenograph::dem {

// Texels of a tile that a map's level 0 is kept in.
inline constexpr int kMapTile = 128;

// Footprints as in ValueMap::Footprint2, by arrays of so many places. Some may be numbers without a meaning.
inline constexpr std::size_t kFootprints = 16;
struct Footprints {
  const double *lat_deg, *lon_deg, *cos_lat;
  const double *a_east_m, *a_north_m, *b_east_m, *b_north_m;
};

// Of a map's level 0: where the middle of the tile's first texel lies, and how many texels of it there are.
struct MapTile {
  const float* texels;
  double west_deg, north_deg;  // of that middle; the longitude in the turn that the footprints are in
  double per_deg_east, per_deg_south;
  int columns, rows;
};

// The mean of each footprint that lies between the middles of four texels of the tile that have values, and is smaller
// than a texel: the map is bilinear there, and the mean is the middle's value and what x times y adds. A bit for each
// that is so, the first the lowest; other `values` mean nothing.
std::uint32_t means_within_texels(const MapTile& tile, const Footprints& footprints, double* values);

}  // namespace selenograph::dem
