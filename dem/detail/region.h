// Where a preset's detail is: everywhere, or within a polygon.
#pragma once

#include <memory>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Const means safe to call concurrently; copies share what they hold.
class Region {
 public:
  Region() = default;  // everywhere
  // Corners in order, either way round; edges are great circles. Throws std::invalid_argument unless there are at least
  // three, none farther than kWidest_deg from their middle, and no edge meets another.
  explicit Region(const std::vector<Geographic>& corners);
  static constexpr double kWidest_deg = 60;

  bool everywhere() const { return !polygon_; }
  // Of a place, as a unit vector.
  bool holds(const Vec3& direction) const { return everywhere() || within(direction); }
  // How far the border is away, on the sphere of 1 737 400 m: positive inside. Infinite: everywhere.
  double inside_m(const Vec3& direction) const;
  // 0 outside, 1 so far inside and farther, and smooth between.
  double share(const Vec3& direction, double fade_m) const;

 private:
  struct Polygon;
  bool within(const Vec3& direction) const;
  std::shared_ptr<const Polygon> polygon_;
};

}  // namespace selenograph::dem
