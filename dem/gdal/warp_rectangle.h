// Rectangle in degrees that a projected raster is warped to. For dem/gdal/ only.
#pragma once

#include <optional>

#include "dem/gdal/library.h"

namespace selenograph::dem {

struct WarpRectangle {
  double west_deg, south_deg, east_deg, north_deg;  // outer borders, west < east
  int width, height;                                // pixels
};

// Returns the rectangle for a raster that crosses the date line, touches a pole, or reaches beyond the limb of its
// projection. The rectangle's pixels are nowhere larger on the ground than the raster's own. GDAL's own choice counts
// such a raster as 360 degrees wide, and makes its pixels as many times wider. Returns empty if that choice will do.
// `srs`: the raster's; `degrees`: longitude and latitude, in that order.
std::optional<WarpRectangle> warp_rectangle(GDALDataset& raster, const OGRSpatialReference& srs,
                                            const OGRSpatialReference& degrees);

}  // namespace selenograph::dem
