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

// With the map's scale and the ground's height, m above the datum, as they are at a pixel; columns as in
// FootprintOnMap. Empty where the map has no Moon there or beside it.
std::optional<Eigen::Matrix2d> metres_per_px(const dem::MapGrid& grid, int column, int row, double height_m);

// No less than a footprint's reach, and hardly more: known without looking for its pixels. Infinite where the map is
// stretched without bounds.
double reach_at_most_px(const LanderFootprint& footprint, const Eigen::Matrix2d& metres_per_px);

// A pixel is covered when its centre is. It takes as long as the footprint is large.
FootprintOnMap footprint_on_map(const LanderFootprint& footprint, const Eigen::Matrix2d& metres_per_px);

}  // namespace selenograph::engine
