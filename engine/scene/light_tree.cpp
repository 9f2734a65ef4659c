#include "engine/scene/light_tree.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "dem/terrain/terrain.h"

namespace selenograph::engine {

LightTree::LightTree(const Sun& sun, const Vec3& up)
    : sun_(sun.direction), radius_(1.01 * std::tan(sun.angular_radius_deg * kRadiansPerDegree)) {
  // v upwards across the light: at a low Sun terrain is thin along it, which is what tells casters from bystanders.
  Vec3 across = up.cross(sun_);
  constexpr double kOverhead = 0.01;
  if (across.norm() <= kOverhead * up.norm())
    across = (std::abs(sun_.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitX()).cross(sun_);
  u_ = across.normalized();
  v_ = sun_.cross(u_);
}

LightTree::Extent LightTree::extent_of(const NodeBounds& b) const {
  Extent e;
  for (const Vec3& p : b.points) {
    const double u = u_.dot(p), v = v_.dot(p), s = sun_.dot(p);
    e.u0 = std::min(e.u0, u);
    e.u1 = std::max(e.u1, u);
    e.v0 = std::min(e.v0, v);
    e.v1 = std::max(e.v1, v);
    e.s0 = std::min(e.s0, s);
    e.s1 = std::max(e.s1, s);
  }
  e.u0 -= b.bulge_m;
  e.v0 -= b.bulge_m;
  e.s0 -= b.bulge_m;
  e.u1 += b.bulge_m;
  e.v1 += b.bulge_m;
  e.s1 += b.bulge_m;
  return e;
}

void LightTree::Extent::include(const Extent& other) {
  u0 = std::min(u0, other.u0);
  u1 = std::max(u1, other.u1);
  v0 = std::min(v0, other.v0);
  v1 = std::max(v1, other.v1);
  s0 = std::min(s0, other.s0);
  s1 = std::max(s1, other.s1);
}

// Even the highest relief is dark once the Sun is further below the horizon than the dip from there to the solid core.
bool LightTree::in_night(const NodeBounds& b) const {
  const double dip = std::acos(dem::kCoreRadius_m / (kMoonRadius_m + b.high_m));
  const double to_sun = std::asin(std::clamp(sun_.dot(b.centre) / b.centre.norm(), -1.0, 1.0));
  return to_sun + std::asin(std::min(1.0, b.radius_m / b.centre.norm())) + std::atan(radius_) < -dip;
}

void LightTree::add_receiver(const NodeBounds& bounds, double pixels_per_metre) {
  if (in_night(bounds)) return;
  receivers_.push_back({extent_of(bounds), pixels_per_metre});
}

void LightTree::finish() {
  if (!receivers_.empty()) add_node(0, receivers_.size());
}

void LightTree::add_node(std::size_t first, std::size_t count) {
  constexpr std::size_t kLeaf = 4;
  const std::size_t at = nodes_.size();
  Node node;
  for (std::size_t i = first; i < first + count; ++i) {
    node.extent.include(receivers_[i].extent);
    node.pixels_per_metre = std::max(node.pixels_per_metre, receivers_[i].pixels_per_metre);
  }
  nodes_.push_back(node);
  if (count <= kLeaf) {
    nodes_[at].first = first;
    nodes_[at].count = count;
  } else {
    const bool along_u = node.extent.u1 - node.extent.u0 > node.extent.v1 - node.extent.v0;
    const auto middle = [&](const Receiver& r) {
      return along_u ? r.extent.u0 + r.extent.u1 : r.extent.v0 + r.extent.v1;
    };
    const auto begin = receivers_.begin() + static_cast<std::ptrdiff_t>(first);
    std::nth_element(begin, begin + static_cast<std::ptrdiff_t>(count / 2), begin + static_cast<std::ptrdiff_t>(count),
                     [&](const Receiver& a, const Receiver& b) { return middle(a) < middle(b); });
    add_node(first, count / 2);
    add_node(first + count / 2, count - count / 2);
  }
  nodes_[at].past = nodes_.size();
}

double LightTree::shaded_pixels_per_metre(const NodeBounds& bounds) const {
  if (receivers_.empty()) return 0;
  Extent e = extent_of(bounds);
  // As far aside as the disc's rim moves its shadow on the receiver that is farthest.
  const double aside = radius_ * std::max(0.0, e.s1 - nodes_.front().extent.s0);
  e.u0 -= aside;
  e.u1 += aside;
  e.v0 -= aside;
  e.v1 += aside;
  double sharpest = 0;
  // A receiver's far end lies behind the caster's near one.
  const auto shaded = [&](const auto& some) {
    const Extent& r = some.extent;
    return some.pixels_per_metre > sharpest && r.u0 <= e.u1 && r.u1 >= e.u0 && r.v0 <= e.v1 && r.v1 >= e.v0 &&
           r.s0 < e.s1;
  };
  for (std::size_t i = 0; i < nodes_.size();) {
    const Node& node = nodes_[i];
    if (!shaded(node)) {
      i = node.past;
      continue;
    }
    for (std::size_t k = node.first; k < node.first + node.count; ++k)
      if (shaded(receivers_[k])) sharpest = receivers_[k].pixels_per_metre;
    ++i;
  }
  return sharpest;
}

}  // namespace selenograph::engine
