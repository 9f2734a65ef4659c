// The region of a preset's detail: everywhere, or within a polygon.
#pragma once

#include <memory>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Thread-safe: const functions may be called concurrently; copies share their data.
class Region {
 public:
  Region() = default;  // everywhere
  // A polygon, its corners clockwise or anticlockwise; edges are great circles. Throws std::invalid_argument unless
  // there are at least three corners, none farther than kWidest_deg from their middle, and no edges intersect.
  explicit Region(const std::vector<Geographic>& corners);
  static constexpr double kWidest_deg = 60;

  bool everywhere() const { return !polygon_; }
  // Returns whether the region contains a direction, a unit vector.
  bool holds(const Vec3& direction) const { return everywhere() || polygon_holds(direction); }
  // Returns the distance from the border on the sphere of 1 737 400 m, positive inside; infinite if the region is
  // everywhere.
  double inside_m(const Vec3& direction) const;
  // Returns 0 outside, 1 at fade_m or more inside, smooth in between.
  double share(const Vec3& direction, double fade_m) const;

 private:
  struct Polygon;
  bool polygon_holds(const Vec3& direction) const;
  std::shared_ptr<const Polygon> polygon_;
};

}  // namespace selenograph::dem
