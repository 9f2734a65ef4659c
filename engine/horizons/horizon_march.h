// Marches from sixteen places to their horizons, over nested grids of heights, for all azimuths.
//
// A march goes outward in segments. A table of the highest posts bounds the tangent of all ground in a segment, and the
// march reads only segments whose bound exceeds the horizon so far:
//
//                         ____ bound: above the horizon, read     . . . . line of sight over the horizon so far
//                        | /\ |  . . . . . . . . .  __________
//    place  . . . . . . .|/. \|                    |  /\__    | bound: below the line, skipped
//      o____.-._/\_______/    \____________________|_/    \___|
//      |fine| segment | segment  |    segment      |   segment     |   each 1/8 of its distance long
//
// Coordinates are gnomonic, as in engine/indirect/relief.h: great circles are straight lines. A place sees the ground
// at an angle a from it, at the Moon's centre, at the plane's distance R tan(a) along its own line; a segment's samples
// have the same angles for all places and azimuths.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "engine/support/packet.h"

namespace selenograph::engine {

// A march may miss ground that would raise the horizon by less than this angle.
inline constexpr double kHorizonTolerance_deg = 0.003;

// A square grid of heights. Posts without data are at kVoidHeight_m.
//
// Places may stand on a lattice of every 2^n-th post. Posts at one offset from four neighbouring places are then
// adjacent: a row holds the columns 0, 2^n, 2 2^n .., then 1, 2^n + 1 .., and so on, each sequence a run.
struct MarchGrid {
  const float* heights;  // m above the reference, rows from the south-west
  int side;
  bool has_lattice = false;
  int columns_log2 = 0;  // n; 0 without a lattice
  int run = 0;           // posts of a run
  int pitch = 0;         // posts from row to row
  float middle;          // row and column of the centre
  float posts_per_m;     // 1 / spacing
  float highest_m;
  // Returns the index of a post in `heights`.
  std::ptrdiff_t index(int column, int row) const {
    const int remainder = column & ((1 << columns_log2) - 1);
    return static_cast<std::ptrdiff_t>(row) * pitch + remainder * run + (column >> columns_log2);
  }
};
inline constexpr float kVoidHeight_m = -1e5F;

// The highest posts around the cells of a coarser grid: cell (i, j) has those in the rows and columns from
// (i - radius) << cell_log2 to (i + radius + 1) << cell_log2.
struct HighestPosts {
  std::vector<float> heights;
  int side;
  int cell_log2;
  int radius;
  // Returns the distance from any point of a cell up to which its value includes all posts, in posts.
  float reach_posts() const { return static_cast<float>(radius << cell_log2); }
};

// Ground at an angle a from the place. tangent of its elevation = (height - own height) / (1 + height / R) rise_per_m -
// drop, with rise_per_m = 1 / (R sin a) and drop = tan(a / 2).
struct MarchSample {
  float plane_m;    // R tan(a)
  float tan_angle;  // tan(a)
  float rise_per_m, drop;
};

// A run of samples in one grid.
struct MarchSegment {
  int grid;
  int first, past_last;            // samples
  int first_part, past_last_part;  // parts, each a short segment; none: samples are read at once
  float middle_m, tan_middle;      // of its middle, as in MarchSample
  float half_m, far_m;             // half its length, and distance of its end, on the plane
  float near_rise_per_m, far_rise_per_m, near_drop;
};

// All that marches of one tile have in common. Samples before `near_samples` lie in the first grid and are always read.
struct MarchPlan {
  std::vector<MarchGrid> grids;
  std::vector<std::vector<HighestPosts>> highest;  // tables of each grid, by increasing reach
  std::vector<MarchSample> samples;
  int near_samples = 0;
  std::vector<MarchSegment> segments, parts;
  float per_radius = 0;    // 1 / radius of height 0, 1/m
  float radius_ratio = 1;  // radius of the datum over that of height 0
};

// Sixteen places in the plane of the grids. A place that looks at an azimuth moves along cos(azimuth) north +
// sin(azimuth) east per metre of plane distance, divided by 1 + tan(a) (cos(azimuth) north_k + sin(azimuth) east_k).
struct alignas(64) MarchPlaces {
  float x[kPacket], y[kPacket];  // m
  float height[kPacket];         // of the eye, m above the reference
  float north_x[kPacket], north_y[kPacket], north_k[kPacket];
  float east_x[kPacket], east_y[kPacket], east_k[kPacket];
  bool valid[kPacket];
  // Lane 4 j + i stands on the lattice of the grids, i places of it east and j south of lane 0.
  bool on_lattice = false;
  float spread_m = 0;     // largest distance in x or y of a place from the first one
  float turn = 0;         // largest difference of a place's direction from the first one's, as length of the difference
  bool on_ground = true;  // eyes are on the ground: its own slope is part of the horizon
};

// Sets elevation_deg[(packet * azimuths + azimuth) * kPacket + lane] to the elevation of the horizon, for azimuths in
// equal steps clockwise from north. NaN in invalid lanes and where no ground has data. Packets should be neighbours:
// all of them march at one azimuth before the next one, so that they find the posts in the processor's cache.
void find_horizons(const MarchPlan& plan, std::span<const MarchPlaces> packets, int azimuths, float* elevation_deg);

}  // namespace selenograph::engine
