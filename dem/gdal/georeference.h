// Post grid from a raster's coordinate system and geotransform. Within dem/gdal/ only.
#pragma once

#include <string>

#include "dem/gdal/library.h"
#include "dem/grid/geodesy.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

struct Georeference {
  PostGrid grid;                        // with the first row in the north and the first column in the west
  double sphere_m = kMoonRadius_m;      // radius of the map's sphere
  bool flip_x = false, flip_y = false;  // stored east to west, south to north
};

// Throws DataError naming `path` when the raster is not on a sphere of the Moon in a supported projection.
Georeference georeference_of(GDALDataset& dataset, const std::string& path);

}  // namespace selenograph::dem
