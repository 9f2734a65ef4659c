// Tree of receivers, which finds the terrain that can cast a shadow into view.
//
// Receivers are boxes in light space: u and v across the sunlight, v upward, s toward the Sun.
//
//    v ^   +-----------+ branch          s ^
//      |   | +--+      |                   |    #### occluder: its (u, v) box overlaps the receiver's,
//      |   | |r1|  +-+ |                   |     ::   and its sunward end is not below the receiver's lower one
//      |   | +--+  +-+ |                   |     ::
//      |   |      r2   |                   |    ____ receiver
//      |   +-----------+                   |
//      +------------------> u              +---------> u
//
// A branch splits its receivers at the median along its longer axis. Receivers near a camera are centimetres wide and
// others kilometres, so a regular grid would not do.
#pragma once

#include <vector>

#include "engine/frame/sun.h"
#include "engine/scene/node_bounds.h"
#include "engine/support/box.h"

namespace selenograph::engine {

// For a solar disc, the occluder's box is widened by the shift of its shadow in light from the disc's rim.
class LightTree {
 public:
  // `up`: direction of the receivers from the Moon's centre. Any value is correct; the true one gives the tightest
  // bounds.
  LightTree(const Sun& sun, const Vec3& up);

  // Adds terrain in view with its weight, pixels per metre. Terrain on the Moon's night side is left out.
  void add_receiver(const NodeBounds& bounds, double pixels_per_metre);
  // Builds the tree. Call it after the last receiver and before the first query.
  void finish();

  // Returns the largest weight of all receivers that this terrain may shade; 0 if there are none.
  double shaded_pixels_per_metre(const NodeBounds& bounds) const;

 private:
  using Box = Box3;  // u, v, s
  struct Receiver {
    Box box;
    double pixels_per_metre;
  };
  // Nodes are stored depth first: `past` is the index after a node's last descendant, where a traversal continues if it
  // skips the node.
  struct Node {
    Box box;
    double pixels_per_metre = 0;  // largest of its receivers
    std::size_t past = 0;
    std::size_t first_receiver = 0, receiver_count = 0;  // range of receivers_, for a leaf
  };
  // Returns the box of some bounds in light space.
  Box box_of(const NodeBounds& bounds) const;
  bool in_night(const NodeBounds& bounds) const;
  void add_node(std::size_t first, std::size_t count);

  Vec3 sun_, u_, v_;
  double tan_radius_;  // tangent of the disc's angular radius, slightly enlarged
  std::vector<Receiver> receivers_;
  std::vector<Node> nodes_;
};

}  // namespace selenograph::engine
