// Regions in degrees: containment, intersection and subdivision. `east_deg` may exceed 180.
#pragma once

#include <optional>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/files/raster_info.h"
#include "dem/grid/geodesy.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {

Footprint footprint_of(const BlockId& id);

// Returns the area of a region on the sphere of 1 737 400 m.
double area_m2(const Footprint& region);

// Returns whether a region contains a position; borders are included.
bool holds(const Footprint& region, const Geographic& position);

// Returns the intersection of two regions, one of which is narrower than half the Moon; empty: they do not touch.
std::optional<Footprint> common(const Footprint& a, const Footprint& b);

// Returns the smallest circle around the region's middle that contains it; the region is narrower than half the Moon.
struct Circle {
  Vec3 middle;      // unit, MOON_ME
  double radius_m;  // length of the chord from the middle to the circle
};
Circle circle_around(const Footprint& region);

// Cuts a region into boxes whose sides are at most `side_m` on the sphere. Throws Cancelled when `stop` is set.
std::vector<Footprint> cut(const Footprint& region, double side_m, const StopToken& stop = {});

// Returns a region that contains everything within a margin of the given one, and slightly more.
Footprint around(const Footprint& region, double margin_m);

// Estimates the number of cells of SizeCells that a query of a region draws, for a range of octaves and a smallest
// size.
double cells_of(int smallest_octave, int largest_octave, const Footprint& region, double smallest_m);

}  // namespace selenograph::dem
