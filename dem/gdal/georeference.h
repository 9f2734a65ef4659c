// What a georeferenced raster's coordinate system and geotransform say about its posts. Within dem/gdal/ only.
#pragma once

#include <string>

#include "dem/gdal/library.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

struct Georeference {
  PostGrid grid;                        // of the raster with its first row in the north, its first column in the west
  bool flip_x = false, flip_y = false;  // stored east to west, south to north
};

// Throws DataError naming `path` where the raster doesn't lie on the Moon's sphere in a projection that is supported.
Georeference georeference_of(GDALDataset& dataset, const std::string& path);

}  // namespace selenograph::dem
