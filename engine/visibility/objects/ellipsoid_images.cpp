#include "engine/visibility/objects/ellipsoid_images.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/objects/ellipsoid_images.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// `maps`: of places to two coordinates in cells and what divides them, each a vector and a number. `touched`: a lane's
// own bit, or none.
void LookUp(const double (*maps)[4], double last, const std::uint32_t* bits, std::int32_t words, const double* x,
            const double* y, const double* z, std::int32_t* HWY_RESTRICT column, std::int32_t* HWY_RESTRICT row,
            std::uint32_t* HWY_RESTRICT touched) {
  const double *u = maps[0], *v = maps[1], *w = maps[2];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double px = x[i];
    const double py = y[i];
    const double pz = z[i];
    const double scale = 1 / (w[3] + w[0] * px + w[1] * py + w[2] * pz);
    const double across = scale * (u[3] + u[0] * px + u[1] * py + u[2] * pz);
    const double down = scale * (v[3] + v[0] * px + v[1] * py + v[2] * pz);
    // So written a lane without a ray, whose numbers may be none, gets cell 0.
    const double c = across > 0 ? across : 0, r = down > 0 ? down : 0;
    column[i] = static_cast<std::int32_t>(c < last ? c : last);
    row[i] = static_cast<std::int32_t>(r < last ? r : last);
  }
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) touched[i] = (bits[row[i] * words + (column[i] >> 5)] >> (column[i] & 31) & 1) << i;
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace selenograph::engine {
namespace {

HWY_EXPORT(LookUp);

// What ellipsoids and rays are compared by: half the ellipsoid's extent along a vector n is the root of n' squares n.
// Which triangle a ray meets is said in float, relative to an anchor: they are larger by what that may be off.
Eigen::Matrix3d squares_of(const Ellipsoid& e, const Vec3& anchor_m) {
  constexpr double kLarger = 0x1p-8;  // (a + b)^2 <= (1 + k) a^2 + (1 + 1 / k) b^2
  const double off = 0x1p-20 * ((e.centre_m - anchor_m).norm() + e.axes_m.norm());
  return (1 + kLarger) * (e.axes_m * e.axes_m.transpose()) +
         (1 + 1 / kLarger) * off * off * Eigen::Matrix3d::Identity();
}

float rounded_up(double value) {
  return std::nextafter(static_cast<float>(value), std::numeric_limits<float>::infinity());
}

double reach_along(const Vec3& n, const Eigen::Matrix3d& squares) { return std::sqrt(n.dot(squares * n)); }

// Slopes of its border along an axis of the image: of the planes through the place that touch it. Of its centre and its
// squares: across, forward, and the two together. Infinite where it lies beside the place, and around it.
std::pair<double, double> slopes(double across, double forward, double across2, double both, double forward2) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  const double a = forward * forward - forward2, b = across * forward - both, c = across * across - across2;
  const double root2 = b * b - a * c;
  if (!(root2 > 0) || a == 0) return {-kInfinite, kInfinite};
  const double root = std::sqrt(root2);
  if (a > 0) return {(b - root) / a, (b + root) / a};
  const bool to_the_right = across * forward2 > forward * both;  // where the plane of no slope cuts it
  return to_the_right ? std::pair((b - root) / a, kInfinite) : std::pair(-kInfinite, (b + root) / a);
}

}  // namespace

EllipsoidImages EllipsoidImages::along(const Vec3& direction, const Vec3& anchor_m,
                                       std::span<const Ellipsoid> ellipsoids) {
  EllipsoidImages images;
  const Vec3 right = direction.unitOrthogonal(), down = direction.cross(right);
  for (int k = 0; k < 3; ++k) {
    images.maps_[0][k] = right[k];
    images.maps_[1][k] = down[k];
    images.height_[k] = direction[k];
  }
  images.maps_[2][3] = 1;
  images.parallel_ = true;
  images.height_[3] = -direction.dot(anchor_m);
  constexpr double kAll = std::numeric_limits<double>::infinity();
  std::vector<Box> boxes;
  boxes.reserve(ellipsoids.size());
  for (const Ellipsoid& e : ellipsoids) {
    const Eigen::Matrix3d squares = squares_of(e, anchor_m);
    const double x = right.dot(e.centre_m);
    const double y = down.dot(e.centre_m);
    const double wide = reach_along(right, squares);
    const double high = reach_along(down, squares);
    const double top = direction.dot(e.centre_m - anchor_m) + reach_along(direction, squares);
    boxes.push_back({{x - wide, y - high}, {x + wide, y + high}, rounded_up(top)});
  }
  images.mark(boxes, {{-kAll, -kAll}, {kAll, kAll}, 0});
  return images;
}

EllipsoidImages EllipsoidImages::from(const Vec3& place_m, const Eigen::Matrix3d& axes, double widest_slope,
                                      std::span<const Ellipsoid> ellipsoids) {
  EllipsoidImages images;
  for (int k = 0; k < 3; ++k)
    for (int c = 0; c < 3; ++c) images.maps_[k][c] = axes(c, k);
  std::vector<Box> boxes;
  boxes.reserve(ellipsoids.size());
  for (const Ellipsoid& e : ellipsoids) {
    const Vec3 c = axes.transpose() * (e.centre_m - place_m);
    const Eigen::Matrix3d squares = axes.transpose() * squares_of(e, place_m) * axes;
    if (c.z() <= -std::sqrt(squares(2, 2))) continue;  // behind
    const auto [left, right] = slopes(c.x(), c.z(), squares(0, 0), squares(0, 2), squares(2, 2));
    const auto [top, bottom] = slopes(c.y(), c.z(), squares(1, 1), squares(1, 2), squares(2, 2));
    boxes.push_back({{left, top}, {right, bottom}, 0});
  }
  images.mark(boxes, {{-widest_slope, -widest_slope}, {widest_slope, widest_slope}, 0});
  return images;
}

void EllipsoidImages::mark(std::span<const Box> boxes, const Box& room) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  Box all{{kInfinite, kInfinite}, {-kInfinite, -kInfinite}, 0};
  bool beyond = false;
  for (const Box& box : boxes)
    for (int k = 0; k < 2; ++k) {
      all.low[k] = std::min(all.low[k], std::max(box.low[k], room.low[k]));
      all.high[k] = std::max(all.high[k], std::min(box.high[k], room.high[k]));
      beyond |= box.low[k] < room.low[k] || box.high[k] > room.high[k];
    }
  for (int k = 0; k < 2; ++k)
    if (!(all.high[k] > all.low[k])) all.low[k] = 0, all.high[k] = 1;  // no image is within the room
  constexpr double kPerEllipsoid = 32;  // cells along an axis, of the square root of the number
  side_ = 2 + std::clamp(static_cast<int>(kPerEllipsoid * std::sqrt(static_cast<double>(boxes.size()))), 62, 2046);
  words_ = (side_ + 31) / 32;
  bits_.assign(static_cast<std::size_t>(side_) * static_cast<std::size_t>(words_), 0);
  squares_ = (side_ + kSquare - 1) / kSquare;
  if (parallel_)
    tops_.assign(static_cast<std::size_t>(squares_) * static_cast<std::size_t>(squares_),
                 -std::numeric_limits<float>::infinity());
  // Cells of the border are touched by what is beyond the room alone.
  constexpr double kSure = 1e-3, kFirst = 1 + 2 * kSure;  // cells
  double per_unit[2];
  for (int k = 0; k < 2; ++k) {
    per_unit[k] = (side_ - 2 * kFirst) / (all.high[k] - all.low[k]);
    for (int c = 0; c < 4; ++c)
      maps_[k][c] = per_unit[k] * maps_[k][c] + (kFirst - per_unit[k] * all.low[k]) * maps_[2][c];
  }
  const auto cell = [&](double at, int k) {
    return static_cast<int>(std::clamp(kFirst + (at - all.low[k]) * per_unit[k], 0.0, side_ - 1.0));
  };
  for (const Box& box : boxes) {
    if (box.high[0] < all.low[0] || box.low[0] > all.high[0] || box.high[1] < all.low[1] || box.low[1] > all.high[1])
      continue;
    Range cells;
    for (int k = 0; k < 2; ++k) {
      cells.first[k] = cell(box.low[k] - kSure / per_unit[k], k);
      cells.last[k] = cell(box.high[k] + kSure / per_unit[k], k);
    }
    set(cells, box.top);
  }
  if (!beyond) return;
  const int last = side_ - 1;
  for (const Range& border : {Range{{0, 0}, {last, 0}}, Range{{0, last}, {last, last}}, Range{{0, 0}, {0, last}},
                              Range{{last, 0}, {last, last}}})
    set(border, 0);
}

void EllipsoidImages::set(const Range& cells, float top) {
  for (int y = cells.first[1]; y <= cells.last[1]; ++y)
    for (int x = cells.first[0]; x <= cells.last[0]; ++x)
      bits_[static_cast<std::size_t>(y * words_ + x / 32)] |= 1U << (x % 32);
  if (!parallel_) return;
  for (int y = cells.first[1] / kSquare; y <= cells.last[1] / kSquare; ++y)
    for (int x = cells.first[0] / kSquare; x <= cells.last[0] / kSquare; ++x) {
      float& highest = tops_[static_cast<std::size_t>(y * squares_ + x)];
      highest = std::max(highest, top);
    }
}

std::uint32_t EllipsoidImages::may_meet(const double x[kPacket], const double y[kPacket], const double z[kPacket],
                                        std::uint32_t asking) const {
  alignas(64) std::int32_t column[kPacket];
  alignas(64) std::int32_t row[kPacket];
  alignas(64) std::uint32_t touched[kPacket];
  HWY_DYNAMIC_DISPATCH(LookUp)(maps_, side_ - 1, bits_.data(), words_, x, y, z, column, row, touched);
  std::uint32_t lanes = 0;
  for (const std::uint32_t lane : touched) lanes |= lane;
  return parallel_ ? before_tops(x, y, z, column, row, lanes & asking) : lanes & asking;
}

std::uint32_t EllipsoidImages::before_tops(const double* x, const double* y, const double* z,
                                           const std::int32_t* column, const std::int32_t* row,
                                           std::uint32_t touched) const {
  std::uint32_t before = touched;
  for (; touched != 0; touched &= touched - 1) {
    const int i = std::countr_zero(touched);
    const double from = height_[3] + height_[0] * x[i] + height_[1] * y[i] + height_[2] * z[i];
    const float top = tops_[static_cast<std::size_t>(row[i] / kSquare * squares_ + column[i] / kSquare)];
    if (from > static_cast<double>(top)) before &= ~(1U << i);
  }
  return before;
}

}  // namespace selenograph::engine

#endif  // HWY_ONCE
