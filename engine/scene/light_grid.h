// Which terrain can cast a shadow into view: receivers binned on a plane across the sunlight.
#pragma once

#include <vector>

#include "engine/frame/sun.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

// A caster matters when, seen along the sunlight, it overlaps a receiver and lies nearer to the Sun. Light from a disc
// comes from its rim, too.
class LightGrid {
 public:
  // `up`: where the receivers are, seen from the Moon's centre. Any will do; bounds are tightest with the right one.
  LightGrid(const Sun& sun, const Vec3& up);

  // Terrain in view, with its pixels per metre. Terrain that is in the Moon's own night is left out.
  void add_receiver(const NodeBounds& bounds, double pixels_per_metre);
  // After the last receiver, before the first question.
  void finish();

  // Largest pixels per metre among the receivers that the terrain could shade; 0: none.
  double shaded_pixels_per_metre(const NodeBounds& bounds) const;

 private:
  struct Extent {
    double u0 = 1e300, u1 = -1e300, v0 = 1e300, v1 = -1e300, s0 = 1e300, s1 = -1e300;
  };
  struct Receiver {
    Extent extent;
    double pixels_per_metre;
  };
  struct Cell {
    double nearest_s = 1e300;  // lowest receiver: farthest from the Sun
    double pixels_per_metre = 0;
  };
  Extent extent_of(const NodeBounds& bounds) const;
  bool in_night(const NodeBounds& bounds) const;
  std::pair<int, int> cells(double low, double high, double origin, double size) const;

  static constexpr int kSide = 128;
  Vec3 sun_, u_, v_;
  double radius_;  // of the Sun's disc: tangent, with a little to spare
  Extent all_;
  std::vector<Receiver> receivers_;
  std::vector<Cell> cells_;
};

}  // namespace selenograph::engine
