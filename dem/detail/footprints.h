// Regions in degrees: what lies in one, and its pieces. `east_deg` may exceed 180.
#pragma once

#include <optional>
#include <vector>

#include "dem/files/raster_info.h"
#include "dem/grid/geodesy.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {

Footprint footprint_of(const BlockId& id);

double area_m2(const Footprint& region);  // on the sphere of 1 737 400 m

// Its borders belong to it.
bool holds(const Footprint& region, const Geographic& place);

// What two regions have in common, one of which is narrower than half the Moon; nothing: they don't touch.
std::optional<Footprint> common(const Footprint& a, const Footprint& b);

// The smallest around its middle that holds all of it, which is narrower than half the Moon.
struct Circle {
  Vec3 middle;      // unit, MOON_ME
  double radius_m;  // along the chord
};
Circle circle_around(const Footprint& region);

// Its pieces, whose sides are no longer than this, on the sphere.
std::vector<Footprint> cut(const Footprint& region, double side_m);

// All that is no farther than so much from it, and some more.
Footprint around(const Footprint& region, double margin_m);

// How many of SizeCells' cells have to be drawn to find what is in a region, of some octaves and at least as large.
double cells_of(int smallest_octave, int largest_octave, const Footprint& region, double smallest_m);

}  // namespace selenograph::dem
