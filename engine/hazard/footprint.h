// The pixels of a map that a lander's footprint covers when it is centred on a pixel.
#pragma once

#include <optional>
#include <vector>

#include "dem/grid/map_grid.h"
#include "engine/frame/map.h"

namespace selenograph::engine {

// The covered pixels of one row, as offsets from the footprint's centre.
struct FootprintRow {
  int row = 0, first = 0, past_last = 0;
};

struct FootprintOnMap {
  Mat2 metres_per_px;              // columns: (east, north) of one pixel to the right and of one down
  std::vector<FootprintRow> rows;  // from the top; none is empty
  int reach_px() const;            // largest offset from the centre along rows or columns
  std::vector<Vec2i> pads;         // (right, down) offsets of the legs; empty: the lander stands on all of it
};

// Returns the map's scale at a pixel whose ground has a height above the datum; columns as in FootprintOnMap. Empty if
// the pixel or a neighbour is off the Moon.
std::optional<Mat2> metres_per_px(const dem::MapGrid& grid, int column, int row, double height_m);

// Returns a close upper bound of a footprint's reach_px(), without finding its pixels. Infinite if the map is stretched
// without bounds.
double reach_upper_bound_px(const LanderFootprint& footprint, const Mat2& metres_per_px);

// Returns the pixels whose centres the footprint covers. Takes time in proportion to the footprint's area.
FootprintOnMap footprint_on_map(const LanderFootprint& footprint, const Mat2& metres_per_px);

}  // namespace selenograph::engine
