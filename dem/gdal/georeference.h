// Post grid from a raster's coordinate system and geotransform. For dem/gdal/ only.
#pragma once

#include <string>

#include "dem/gdal/library.h"
#include "dem/grid/geodesy.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

struct Georeference {
  PostGrid grid;                        // first row in the north, first column in the west
  double sphere_m = kMoonRadius_m;      // radius of the map's sphere
  bool flip_x = false, flip_y = false;  // the file stores columns east to west, rows south to north
};

// Returns the post grid of a raster. Throws DataError naming `path` when the raster is not on a sphere of the Moon in a
// supported projection.
Georeference georeference_of(GDALDataset& dataset, const std::string& path);

}  // namespace selenograph::dem
