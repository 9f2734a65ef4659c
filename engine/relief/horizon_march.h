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
// Coordinates are gnomonic (relief.h): great circles are straight lines. A place sees the ground at an angle a from it,
// at the Moon's centre, at the plane's distance R tan(a) along its own line; a segment's samples have the same angles
// for all places and azimuths.
#pragma once

#include <span>

#include "engine/relief/horizon_plan.h"
#include "engine/support/packet.h"

namespace selenograph::engine {

// A march may miss ground that would raise the horizon by less than this angle.
inline constexpr double kHorizonTolerance_deg = 0.003;

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
