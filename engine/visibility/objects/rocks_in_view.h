// Which rocks of a detail a frame shows: those that are large enough in it, in view or with their shadow.
#pragma once

#include <vector>

#include "dem/detail/rocks_on_ground.h"
#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {

struct RocksInView {
  std::vector<dem::RockFeature> rocks;  // the largest first
  double least_px = 0;                  // diameter of the smallest, where the camera is nearest
};

// Rocks are shown from a diameter of 2 max_error_px pixels on, so that what is left out is no higher than the mesh's
// error may be; and from kLeastRock_px on at least. Where that were more than kMostRocks (frame/needs.h), the diameter
// is doubled until it isn't. `blocks`: that the frame is made of.
inline constexpr double kLeastRock_px = 0.5;
RocksInView rocks_in_view(const dem::Terrain& terrain, const RowViews& views, const Sun* sun,
                          const std::vector<dem::BlockId>& blocks, double max_error_px, const StopToken& stop);

// The level of the blocks in which an octave's rocks are looked for: some 60 of its smallest diameters wide. Those that
// are smaller yet are looked for in the finest.
int level_of_rocks(int octave);

// How many of an octave the law expects in a region, between craters.
double expected_of(const dem::RockField& field, int octave, const dem::Footprint& region, double smallest_m);

}  // namespace selenograph::engine
