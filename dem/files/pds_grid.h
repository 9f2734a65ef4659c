// Sphere and post grid of a PDS3 map.
#pragma once

#include "dem/files/pds_label.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

// Returns the radius of the map's sphere, m. Throws DataError for another body than the Moon, or an ellipsoid.
double pds_sphere_m(const PdsReader& label, const PdsReader& map);

// Returns the post grid of a map. `map`: the label's IMAGE_MAP_PROJECTION. Throws DataError if the label contradicts
// itself, or its projection is not supported.
PostGrid pds_grid(const PdsReader& label, const PdsReader& map, double sphere_m, int width, int height);

}  // namespace selenograph::dem
