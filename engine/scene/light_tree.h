// Which terrain can cast a shadow into view: receivers on a plane across the sunlight, in a tree of rectangles. Those
// near a camera are centimetres wide where the others are kilometres away: a grid would be too coarse for them.
#pragma once

#include <vector>

#include "engine/frame/sun.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

// A caster matters when, seen along the sunlight, it overlaps a receiver and lies nearer to the Sun. Light from a disc
// comes from its rim, too.
class LightTree {
 public:
  // `up`: where the receivers are, seen from the Moon's centre. Any will do; bounds are tightest with the right one.
  LightTree(const Sun& sun, const Vec3& up);

  // Terrain in view, with its pixels per metre. Terrain that is in the Moon's own night is left out.
  void add_receiver(const NodeBounds& bounds, double pixels_per_metre);
  // After the last receiver, before the first question.
  void finish();

  // Largest pixels per metre among the receivers that the terrain could shade; 0: none.
  double shaded_pixels_per_metre(const NodeBounds& bounds) const;

 private:
  struct Extent {
    double u0 = 1e300, u1 = -1e300, v0 = 1e300, v1 = -1e300, s0 = 1e300, s1 = -1e300;
    void include(const Extent& other);
  };
  struct Receiver {
    Extent extent;
    double pixels_per_metre;
  };
  // The nodes of a branch follow it; behind all of them is `past`.
  struct Node {
    Extent extent;
    double pixels_per_metre = 0;  // the largest
    std::size_t past = 0;
    std::size_t first = 0, count = 0;  // of a leaf's receivers
  };
  Extent extent_of(const NodeBounds& bounds) const;
  bool in_night(const NodeBounds& bounds) const;
  void add_node(std::size_t first, std::size_t count);

  Vec3 sun_, u_, v_;
  double radius_;  // of the Sun's disc: tangent, with a little to spare
  std::vector<Receiver> receivers_;
  std::vector<Node> nodes_;
};

}  // namespace selenograph::engine
