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
  // A polygon of corners in either order; edges are great circles. Throws std::invalid_argument unless there are at
  // least three corners, none farther than kWidest_deg from their middle, and no edges intersect.
  explicit Region(const std::vector<Geographic>& corners);
  static constexpr double kWidest_deg = 60;

  bool everywhere() const { return !polygon_; }
  // Whether it contains a place, given as a unit vector.
  bool holds(const Vec3& direction) const { return everywhere() || within(direction); }
  // Distance from the border on the sphere of 1 737 400 m, positive inside; infinite if the region is everywhere.
  double inside_m(const Vec3& direction) const;
  // 0 outside, 1 at fade_m or more inside, smooth in between.
  double share(const Vec3& direction, double fade_m) const;

 private:
  struct Polygon;
  bool within(const Vec3& direction) const;
  std::shared_ptr<const Polygon> polygon_;
};

}  // namespace selenograph::dem
