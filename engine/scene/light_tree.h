// Finds terrain that can cast a shadow into view: receivers projected on a plane normal to the sunlight, in a tree of
// rectangles. Receivers near a camera are centimetres wide and others kilometres, so a grid would be too coarse.
#pragma once

#include <vector>

#include "engine/frame/sun.h"
#include "engine/scene/node_bounds.h"

namespace selenograph::engine {

// A caster matters when, seen along the sunlight, it overlaps a receiver and is nearer to the Sun. For a solar disc,
// light from its limb counts, too.
class LightTree {
 public:
  // `up`: direction of the receivers from the Moon's centre. Any value is correct; the right one gives the tightest
  // bounds.
  LightTree(const Sun& sun, const Vec3& up);

  // Adds terrain in view, with its pixels per metre. Terrain on the Moon's own night side is left out.
  void add_receiver(const NodeBounds& bounds, double pixels_per_metre);
  // Call after the last receiver and before the first query.
  void finish();

  // Largest pixels per metre among the receivers that this terrain could shade; 0: none.
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
  // The nodes of a branch follow it; `past` is the index after the last of them.
  struct Node {
    Extent extent;
    double pixels_per_metre = 0;  // the largest
    std::size_t past = 0;
    std::size_t first = 0, count = 0;  // receivers of a leaf
  };
  Extent extent_of(const NodeBounds& bounds) const;
  bool in_night(const NodeBounds& bounds) const;
  void add_node(std::size_t first, std::size_t count);

  Vec3 sun_, u_, v_;
  double radius_;  // tangent of the disc's angular radius, slightly enlarged
  std::vector<Receiver> receivers_;
  std::vector<Node> nodes_;
};

}  // namespace selenograph::engine
