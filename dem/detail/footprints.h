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

double area_m2(const Footprint& region);  // on the sphere of 1 737 400 m

// Borders are included.
bool holds(const Footprint& region, const Geographic& place);

// Intersection of two regions, one of which is narrower than half the Moon; empty: they do not touch.
std::optional<Footprint> common(const Footprint& a, const Footprint& b);

// Smallest circle around the region's middle that contains it; the region is narrower than half the Moon.
struct Circle {
  Vec3 middle;      // unit, MOON_ME
  double radius_m;  // along the chord
};
Circle circle_around(const Footprint& region);

// Pieces of a region whose sides are at most this long on the sphere. Throws Cancelled when `stop` says so.
std::vector<Footprint> cut(const Footprint& region, double side_m, const StopToken& stop = {});

// A region that contains everything within a margin, and slightly more.
Footprint around(const Footprint& region, double margin_m);

// Number of cells of SizeCells that must be drawn to find what is in a region, for some octaves and a smallest size.
double cells_of(int smallest_octave, int largest_octave, const Footprint& region, double smallest_m);

}  // namespace selenograph::dem
