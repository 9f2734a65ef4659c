// Grid of the posts of a PDS3 map.
#pragma once

#include "dem/files/pds_label.h"
#include "dem/grid/post_grid.h"

namespace selenograph::dem {

// `map`: the label's IMAGE_MAP_PROJECTION. Throws DataError where the label contradicts itself, or its projection is
// not supported.
PostGrid pds_grid(const PdsReader& label, const PdsReader& map, int width, int height);

}  // namespace selenograph::dem
