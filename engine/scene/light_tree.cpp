#include "engine/scene/light_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/terrain/terrain.h"

namespace selenograph::engine {

LightTree::LightTree(const Sun& sun, const Vec3& up)
    : sun_(sun.direction), tan_radius_(1.01 * std::tan(sun.angular_radius_deg * kRadiansPerDegree)) {
  // Turn v upward: under a low Sun terrain is thin along it, and thin boxes tell occluders from bystanders.
  Vec3 across = up.cross(sun_);
  constexpr double kOverhead = 0.01;
  if (across.norm() <= kOverhead * up.norm())
    across = (std::abs(sun_.z()) < 0.9 ? Vec3::unit_z() : Vec3::unit_x()).cross(sun_);
  u_ = across.normalized();
  v_ = sun_.cross(u_);
}

LightTree::Box LightTree::box_of(const NodeBounds& b) const {
  Box box;
  for (const Vec3& p : b.points) box.extend(Vec3(u_.dot(p), v_.dot(p), sun_.dot(p)));
  return {box.min - Vec3::constant(b.bulge_m), box.max + Vec3::constant(b.bulge_m)};
}

// The highest relief is dark once the Sun is farther below the horizon than the dip from its top to the solid core.
bool LightTree::in_night(const NodeBounds& b) const {
  const double dip = std::acos(dem::kCoreRadius_m / (kMoonRadius_m + b.high_m));
  const double to_sun = std::asin(std::clamp(sun_.dot(b.centre) / b.centre.norm(), -1.0, 1.0));
  return to_sun + std::asin(std::min(1.0, b.radius_m / b.centre.norm())) + std::atan(tan_radius_) < -dip;
}

void LightTree::add_receiver(const NodeBounds& bounds, double pixels_per_metre) {
  if (in_night(bounds)) return;
  receivers_.push_back({box_of(bounds), pixels_per_metre});
}

void LightTree::finish() {
  if (!receivers_.empty()) add_node(0, receivers_.size());
}

// Adds the node of some receivers and, before any other node, those of its halves: a node's descendants follow it in
// nodes_ up to `past`.
void LightTree::add_node(std::size_t first, std::size_t count) {
  constexpr std::size_t kLeaf = 4;
  const std::size_t index = nodes_.size();
  Node node;
  for (std::size_t i = first; i < first + count; ++i) {
    node.box.extend(receivers_[i].box);
    node.pixels_per_metre = std::max(node.pixels_per_metre, receivers_[i].pixels_per_metre);
  }
  nodes_.push_back(node);
  if (count <= kLeaf) {
    nodes_[index].first_receiver = first;
    nodes_[index].receiver_count = count;
  } else {
    // Split at the median along the longer axis.
    const int axis = node.box.size().x() > node.box.size().y() ? 0 : 1;
    const auto middle = [&](const Receiver& r) { return r.box.min[axis] + r.box.max[axis]; };
    const auto begin = receivers_.begin() + static_cast<std::ptrdiff_t>(first);
    std::nth_element(begin, begin + static_cast<std::ptrdiff_t>(count / 2), begin + static_cast<std::ptrdiff_t>(count),
                     [&](const Receiver& a, const Receiver& b) { return middle(a) < middle(b); });
    add_node(first, count / 2);
    add_node(first + count / 2, count - count / 2);
  }
  nodes_[index].past = nodes_.size();
}

// Walks the tree in memory order, and steps over the descendants of a node that the occluder cannot shade.
double LightTree::shaded_pixels_per_metre(const NodeBounds& bounds) const {
  if (receivers_.empty()) return 0;
  const Box occluder = box_of(bounds);
  // Widen the box by the shift of the shadow, on the farthest receiver, in light from the disc's rim.
  const double shift_m = tan_radius_ * std::max(0.0, occluder.max.z() - nodes_.front().box.min.z());
  // Its shadow extends away from the Sun without end.
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const Box shadow{occluder.min - Vec3(shift_m, shift_m, kInfinity), occluder.max + Vec3(shift_m, shift_m, 0)};
  double max_pixels_per_metre = 0;
  const auto may_be_shaded = [&](const auto& candidate) {
    return candidate.pixels_per_metre > max_pixels_per_metre && candidate.box.intersects(shadow);
  };
  for (std::size_t i = 0; i < nodes_.size();) {
    const Node& node = nodes_[i];
    if (!may_be_shaded(node)) {
      i = node.past;
      continue;
    }
    for (std::size_t k = node.first_receiver; k < node.first_receiver + node.receiver_count; ++k)
      if (may_be_shaded(receivers_[k])) max_pixels_per_metre = receivers_[k].pixels_per_metre;
    ++i;
  }
  return max_pixels_per_metre;
}

}  // namespace selenograph::engine
