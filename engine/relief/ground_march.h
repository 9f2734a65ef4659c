// Marches along great circles over a relief, from sixteen points in a row, which find all ground in their view.
//
// A march looks along one azimuth and keeps the highest elevation so far, the horizon. The ground of a step is visible
// if it rises above the horizon; it is then a segment, from the old horizon to the new one.
//
//                       ___  visible         . . . line of sight over the last crest
//    point    visible  /   \     . . . . . _____
//      o     ____.----'     \  hidden     /     \ visible
//       \___/                \___________/       \____
//    |--|--|--|--|--|--|--|----|----|------|------|-----   steps: the finest spacing, then 1/24 of the distance;
//                                                          quarter steps around crests and walls
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "engine/relief/relief.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// At a distance d a step is d / kStepsPerDistance long, at least the finest grid's spacing. It reads the coarsest grid
// of which it spans kPostsPerStep posts. So a grid of spacing s serves distances of up to 2 kPostsPerStep
// kStepsPerDistance s: ReliefShape::posts_per_distance.
inline constexpr float kStepsPerDistance = 24, kPostsPerStep = 2;

// Tangent of a horizon without any ground.
inline constexpr float kNoHorizon = -std::numeric_limits<float>::infinity();

// Sixteen points in a row, equally spaced in x, and their common direction; the grids' coordinates.
struct alignas(64) MarchLanes {
  float x[kPacket], y;                // m
  alignas(64) float height[kPacket];  // m above the reference
  float ux, uy;                       // unit vector of the direction
};

// Returns sixteen posts of a relief's finest grid, `stride` columns apart. The caller sets their direction.
MarchLanes posts_in_row(const Relief& relief, int row, int column, int stride);

// Sets tangent[i] to the tangent of the horizon's elevation at each lane, or to kNoHorizon. A march may end
// once each horizon is above sufficient_tangent[i] (an aligned array, as `tangent`). Marches read the grids from
// `first_grid` on. Lanes i and i + 1 are `stride` columns of the finest grid apart, a power of two.
void find_horizon_ahead(const Relief& relief, std::size_t first_grid, const MarchLanes& lanes, int stride,
                        const float* sufficient_tangent, float* tangent);

// Ground that one step of a march adds to the view of sixteen points: its cells, and how far the tangent of each lane's
// horizon rises there. The cells lie in one row, GroundView::stride / ReliefGrid::coarser columns apart.
struct GroundSegment {
  float column;       // of the first lane's cell
  std::uint16_t row;  // of the cells
  std::uint8_t grid;  // from the view's first one on
  std::uint8_t unused = 0;
  // Numbers with five bits of exponent and three of mantissa, from 2^-24 on; 0 in lanes that see nothing. A rise is
  // that from the sum of the lane's rises so far, so that their rounding errors do not add up.
  std::uint8_t rise[kPacket];
};
static_assert(sizeof(GroundSegment) == 24);

// GroundSegment::rise as bits of a float: the shift of the mantissa, and the number whose code is 0.
inline constexpr int kRiseShift = 20;
inline constexpr std::uint32_t kRiseZero = std::uint32_t{127 - 24} << 23;

// The ground that sixteen points in a row see. It depends on no light.
struct GroundView {
  struct alignas(64) Azimuth {
    float first_tangent[kPacket];  // horizons where they begin; 0 without ground
    float ux, uy;                  // unit vector of the direction
    std::uint32_t past_last;       // index of the segment after this azimuth's; they begin where the last azimuth's end
  };
  // A square of cells, by its index in a grid.
  struct Square {
    std::uint32_t grid, index;
  };
  int stride = 1;  // columns of the finest grid from point to point
  std::vector<Azimuth> azimuths;
  std::vector<GroundSegment> segments;  // by azimuth, nearest first
  std::vector<Square> squares;          // squares with cells of any segment
  float sky[3][kPacket] = {};           // sum over azimuths of the direction's integral over the sky, see add_sky()
  std::size_t bytes() const {
    return sizeof *this + azimuths.capacity() * sizeof(Azimuth) + segments.capacity() * sizeof(GroundSegment) +
           squares.capacity() * sizeof(Square);
  }
};

// Appends an azimuth, the lanes' direction, to a view. Sets horizon[i] as find_horizon_ahead() does.
void find_visible_ground(const Relief& relief, std::size_t first_grid, const MarchLanes& lanes, GroundView& view,
                         float* horizon);

}  // namespace selenograph::engine
