// Writes posts and maps as GeoTIFF files that GIS programs can place.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <variant>

#include "dem/base/stop_token.h"
#include "dem/grid/map_grid.h"

namespace selenograph::dem {

// Rectangle of posts on the Moon's sphere of 1 737 400 m: latitude and longitude of the first (north-westernmost) post
// and the steps to its neighbours, southwards and eastwards. Degrees.
struct GeotiffGrid {
  double north_deg = 0, west_deg = 0;
  double lat_step_deg = 0, lon_step_deg = 0;
  int width = 0, height = 0;
};

// Writes posts as float32, row 0 in the north, a post at each pixel's centre; NaN is declared as NoData. `name`
// describes the band. The file is written atomically. Throws DataError, or SystemFault naming it.
void write_geotiff(const std::string& path, const GeotiffGrid& grid, std::span<const float> values,
                   const std::string& name);

// Returns the same file in memory.
std::string geotiff_bytes(const GeotiffGrid& grid, std::span<const float> values, const std::string& name);

// Band of a map: every step-th element, starting at `values`.
struct MapBand {
  std::string name, unit;  // unit: empty if there is none
  std::variant<const std::uint16_t*, const float*, const double*> values;
  int step = 1;
};
inline constexpr std::uint16_t kNoMapNumber = 65535;  // NoData of bands of uint16

// Returns a GeoTIFF with the widest of the bands' types. NoData is NaN; for uint16 bands only, kNoMapNumber, which
// becomes NaN among floats. `metadata`: content of the dataset's item SELENOGRAPH. Throws DataError, or Cancelled when
// `stop` is requested.
std::string geotiff_bytes(const MapGrid& grid, std::span<const MapBand> bands, const std::string& metadata,
                          const StopToken& stop);
// Returns an approximate upper bound of that file's size, including working memory.
std::size_t geotiff_bytes_at_most(const MapGrid& grid, std::span<const MapBand> bands);

// Return the coordinate system as WKT 2, and the geotransform of the pixels' corners, as defined by GDAL.
std::string wkt_of(const MapPlane& plane);
std::array<double, 6> geotransform_of(const MapGrid& grid);

}  // namespace selenograph::dem
