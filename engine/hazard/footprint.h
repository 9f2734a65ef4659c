// The pixels of a map that a lander's footprint covers, about a pixel.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "dem/grid/map_grid.h"
#include "engine/frame/map.h"

namespace selenograph::engine {

// Offsets from the middle, in pixels: those of a row that are covered.
struct FootprintRow {
  int row = 0, first = 0, past_last = 0;
};

struct FootprintOnMap {
  Eigen::Matrix2d metres_per_px;      // columns: east and north of a step to the right and of one down
  std::vector<FootprintRow> rows;     // from the top; none is empty
  int reach_px() const;               // from the middle, along rows or columns
  std::vector<Eigen::Vector2i> pads;  // right and down: where the legs stand; empty: on all of it
};

// With the map's scale and the ground's height, m above the datum, as they are at a pixel. Empty where the map has no
// Moon. A pixel is covered when its centre is.
std::optional<FootprintOnMap> footprint_on_map(const LanderFootprint& footprint, const dem::MapGrid& grid, int column,
                                               int row, double height_m);

}  // namespace selenograph::engine
