// Selects the rocks of a detail that a frame shows: large enough, and in view themselves or with their shadow.
#pragma once

#include <memory>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/rocks_on_ground.h"
#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {

struct RocksInView {
  std::vector<dem::RockFeature> rocks;  // largest first
  double least_px = 0;                  // diameter of the smallest rock, in pixels at its nearest to the camera
};

// Selects the rocks of a frame. Rocks are shown from a diameter of 2 max_error_px pixels, so that omitted rocks are no
// higher than the error bound of the mesh, and of at least kMinRock_px. If that gives more than kMaxRocks
// (frame/needs.h), the diameter is doubled until it does not. `blocks`: blocks of the frame. `memory`: rocks that
// earlier frames have found.
inline constexpr double kMinRock_px = 0.5;
RocksInView rocks_in_view(const dem::Terrain& terrain, std::shared_ptr<dem::RockMemory> memory, const RowViews& views,
                          const Sun* sun, const std::vector<dem::BlockId>& blocks, double max_error_px,
                          const StopToken& stop);

// Adds the rocks of `from` that `to` lacks, largest first, and keeps the kMaxRocks largest.
void add_rocks(RocksInView from, RocksInView& to);

// Returns the level of the blocks in which the rocks of an octave are searched: about 60 of its smallest diameters
// wide, or the finest level.
int level_of_rocks(int octave);

// Returns the expected number of rocks of an octave in a region between craters.
double expected_rocks(const dem::RockField& field, int octave, const dem::Footprint& region, double smallest_m);

}  // namespace selenograph::engine
