// Posts -> GeoTIFF, as GIS programs open it in place.
#pragma once

#include <span>
#include <string>

namespace selenograph::dem {

// A rectangle of posts on the Moon's sphere of 1 737 400 m: latitude and longitude of the first (north-westernmost)
// post and the steps to its neighbours, southwards and eastwards. Degrees.
struct GeotiffGrid {
  double north_deg = 0, west_deg = 0;
  double lat_step_deg = 0, lon_step_deg = 0;
  int width = 0, height = 0;
};

// float32, row 0 in the north, a post at each pixel's centre; NaN is declared as NoData. `name` describes the band.
// The file appears whole or not at all (temporary name, then rename). Throws DataError naming it.
void write_geotiff(const std::string& path, const GeotiffGrid& grid, std::span<const float> values,
                   const std::string& name);

// The same in memory.
std::string geotiff_bytes(const GeotiffGrid& grid, std::span<const float> values, const std::string& name);

}  // namespace selenograph::dem
