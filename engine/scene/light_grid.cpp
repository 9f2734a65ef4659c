#include "engine/scene/light_grid.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "dem/terrain.h"

namespace selenograph::engine {

LightGrid::LightGrid(const Sun& sun, const Vec3& up)
    : sun_(sun.direction), radius_(1.01 * std::tan(sun.angular_radius_deg * kRadiansPerDegree)) {
  // v upwards across the light: at a low Sun terrain is thin along it, which is what tells casters from bystanders.
  Vec3 across = up.cross(sun_);
  constexpr double kOverhead = 0.01;
  if (across.norm() <= kOverhead * up.norm())
    across = (std::abs(sun_.z()) < 0.9 ? Vec3::UnitZ() : Vec3::UnitX()).cross(sun_);
  u_ = across.normalized();
  v_ = sun_.cross(u_);
}

LightGrid::Extent LightGrid::extent_of(const NodeBounds& b) const {
  Extent e;
  for (const Vec3& p : b.points) {
    const double u = u_.dot(p), v = v_.dot(p), s = sun_.dot(p);
    e.u0 = std::min(e.u0, u), e.u1 = std::max(e.u1, u), e.v0 = std::min(e.v0, v), e.v1 = std::max(e.v1, v);
    e.s0 = std::min(e.s0, s), e.s1 = std::max(e.s1, s);
  }
  e.u0 -= b.bulge_m, e.v0 -= b.bulge_m, e.s0 -= b.bulge_m;
  e.u1 += b.bulge_m, e.v1 += b.bulge_m, e.s1 += b.bulge_m;
  return e;
}

// Even the highest relief is dark once the Sun is further below the horizon than the dip from there to the solid core.
bool LightGrid::in_night(const NodeBounds& b) const {
  const double dip = std::acos((kMoonRadius_m + dem::kLowestRelief_m) / (kMoonRadius_m + b.high_m));
  const double to_sun = std::asin(std::clamp(sun_.dot(b.centre) / b.centre.norm(), -1.0, 1.0));
  return to_sun + std::asin(std::min(1.0, b.radius_m / b.centre.norm())) + std::atan(radius_) < -dip;
}

void LightGrid::add_receiver(const NodeBounds& bounds, double pixels_per_metre) {
  if (in_night(bounds)) return;
  const Extent e = extent_of(bounds);
  all_.u0 = std::min(all_.u0, e.u0), all_.u1 = std::max(all_.u1, e.u1);
  all_.v0 = std::min(all_.v0, e.v0), all_.v1 = std::max(all_.v1, e.v1);
  all_.s0 = std::min(all_.s0, e.s0);
  receivers_.push_back({e, pixels_per_metre});
}

std::pair<int, int> LightGrid::cells(double low, double high, double origin, double size) const {
  const double scale = kSide / std::max(size, 1e-6);
  return {static_cast<int>(std::clamp((low - origin) * scale, 0.0, kSide - 1.0)),
          static_cast<int>(std::clamp((high - origin) * scale, 0.0, kSide - 1.0))};
}

void LightGrid::finish() {
  cells_.assign(static_cast<std::size_t>(kSide) * kSide, {});
  for (const Receiver& r : receivers_) {
    const auto [i0, i1] = cells(r.extent.u0, r.extent.u1, all_.u0, all_.u1 - all_.u0);
    const auto [j0, j1] = cells(r.extent.v0, r.extent.v1, all_.v0, all_.v1 - all_.v0);
    for (int j = j0; j <= j1; ++j)
      for (int i = i0; i <= i1; ++i) {
        Cell& cell = cells_[static_cast<std::size_t>(j) * kSide + static_cast<std::size_t>(i)];
        cell.nearest_s = std::min(cell.nearest_s, r.extent.s0);
        cell.pixels_per_metre = std::max(cell.pixels_per_metre, r.pixels_per_metre);
      }
  }
}

double LightGrid::shaded_pixels_per_metre(const NodeBounds& bounds) const {
  if (receivers_.empty()) return 0;
  Extent e = extent_of(bounds);
  // As far aside as the disc's rim moves its shadow on the receiver that is farthest.
  const double aside = radius_ * std::max(0.0, e.s1 - all_.s0);
  e.u0 -= aside, e.u1 += aside, e.v0 -= aside, e.v1 += aside;
  if (e.u1 < all_.u0 || e.u0 > all_.u1 || e.v1 < all_.v0 || e.v0 > all_.v1) return 0;
  const auto [i0, i1] = cells(e.u0, e.u1, all_.u0, all_.u1 - all_.u0);
  const auto [j0, j1] = cells(e.v0, e.v1, all_.v0, all_.v1 - all_.v0);
  double sharpest = 0;
  for (int j = j0; j <= j1; ++j)
    for (int i = i0; i <= i1; ++i) {
      const Cell& cell = cells_[static_cast<std::size_t>(j) * kSide + static_cast<std::size_t>(i)];
      if (cell.nearest_s < e.s1) sharpest = std::max(sharpest, cell.pixels_per_metre);
    }
  return sharpest;
}

}  // namespace selenograph::engine
