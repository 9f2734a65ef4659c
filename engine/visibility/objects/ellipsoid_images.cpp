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

// Finds the cell of each lane: column (u) and row (v), from 0 to `last`. `maps`: as EllipsoidImages::maps_. `bits`: the
// marked cells, `words` words per row. `touched`: the bit of the lane if its cell is marked, else 0.
void FindCells(const double (*maps)[4], double last, const std::uint32_t* bits, std::int32_t words, const double* x,
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
    // Compare in this order: a lane without a ray may be NaN, and then gets cell 0.
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

HWY_EXPORT(FindCells);

// Returns a matrix S such that half the extent of the ellipsoid along a unit vector n is sqrt(n' S n). The ellipsoid is
// enlarged by the rounding error of float relative to the anchor, since float decides which triangle a ray hits.
Mat3 squares_of(const Ellipsoid& e, const Vec3& anchor_m) {
  constexpr double kLarger = 0x1p-8;  // (a + b)^2 <= (1 + k) a^2 + (1 + 1 / k) b^2
  const double off = 0x1p-20 * ((e.centre_m - anchor_m).norm() + e.axes_m.norm());
  return (1 + kLarger) * (e.axes_m * e.axes_m.transpose()) + (1 + 1 / kLarger) * off * off * Mat3::identity();
}

float rounded_up(double value) {
  return std::nextafter(static_cast<float>(value), std::numeric_limits<float>::infinity());
}

// Returns half the extent along n of the ellipsoid with this matrix.
double reach_along(const Vec3& n, const Mat3& squares) { return std::sqrt(n.dot(squares * n)); }

// Returns the slopes of the silhouette of an ellipsoid along an axis of the image: of the planes through the origin
// that touch it. Arguments are its centre across and forward, and its matrix entries for across, both, and forward. A
// slope is infinite on a side where the ellipsoid reaches beside the origin; both are if it encloses the origin.
std::pair<double, double> silhouette_slopes(double across, double forward, double across2, double both,
                                            double forward2) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  const double a = forward * forward - forward2, b = across * forward - both, c = across * across - across2;
  // The slopes s solve a s^2 - 2 b s + c = 0.
  const double root2 = b * b - a * c;
  if (!(root2 > 0) || a == 0) return {-kInfinite, kInfinite};
  const double root = std::sqrt(root2);
  if (a > 0) return {(b - root) / a, (b + root) / a};
  // Beside the origin, a slope bounds only the side on which the plane of slope 0 cuts the ellipsoid.
  const bool to_the_right = across * forward2 > forward * both;
  return to_the_right ? std::pair((b - root) / a, kInfinite) : std::pair(-kInfinite, (b + root) / a);
}

}  // namespace

EllipsoidImages EllipsoidImages::along(const Vec3& direction, const Vec3& anchor_m,
                                       std::span<const Ellipsoid> ellipsoids) {
  EllipsoidImages images;
  const Vec3 right = direction.unit_orthogonal(), down = direction.cross(right);
  for (int k = 0; k < 3; ++k) {
    images.maps_[0][k] = right[k];
    images.maps_[1][k] = down[k];
    images.height_[k] = direction[k];
  }
  images.maps_[2][3] = 1;
  images.parallel_ = true;
  images.height_[3] = -direction.dot(anchor_m);
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  std::vector<Box> boxes;
  boxes.reserve(ellipsoids.size());
  for (const Ellipsoid& ellipsoid : ellipsoids) {
    const Mat3 squares = squares_of(ellipsoid, anchor_m);
    const double column_m = right.dot(ellipsoid.centre_m);
    const double row_m = down.dot(ellipsoid.centre_m);
    const double half_width = reach_along(right, squares);
    const double half_height = reach_along(down, squares);
    const double top = direction.dot(ellipsoid.centre_m - anchor_m) + reach_along(direction, squares);
    boxes.push_back(
        {{column_m - half_width, row_m - half_height}, {column_m + half_width, row_m + half_height}, rounded_up(top)});
  }
  images.mark(boxes, {{-kInfinite, -kInfinite}, {kInfinite, kInfinite}, 0});
  return images;
}

EllipsoidImages EllipsoidImages::from(const Vec3& origin_m, const Mat3& axes, double widest_slope,
                                      std::span<const Ellipsoid> ellipsoids) {
  EllipsoidImages images;
  for (int axis = 0; axis < 3; ++axis)
    for (int k = 0; k < 3; ++k) images.maps_[axis][k] = axes(k, axis);
  std::vector<Box> boxes;
  boxes.reserve(ellipsoids.size());
  for (const Ellipsoid& ellipsoid : ellipsoids) {
    const Vec3 centre = axes.transpose_times(ellipsoid.centre_m - origin_m);
    const Mat3 squares = axes.transpose_times(squares_of(ellipsoid, origin_m)) * axes;
    if (centre.z() <= -std::sqrt(squares(2, 2))) continue;  // behind
    const auto [left, right] = silhouette_slopes(centre.x(), centre.z(), squares(0, 0), squares(0, 2), squares(2, 2));
    const auto [top, bottom] = silhouette_slopes(centre.y(), centre.z(), squares(1, 1), squares(1, 2), squares(2, 2));
    boxes.push_back({{left, top}, {right, bottom}, 0});
  }
  images.mark(boxes, {{-widest_slope, -widest_slope}, {widest_slope, widest_slope}, 0});
  return images;
}

// Lays cells over the part of the boxes within the limits, appends their scale to maps_, and marks the cells that the
// boxes touch. All border cells are marked if a box crosses the limits.
void EllipsoidImages::mark(std::span<const Box> boxes, const Box& limits) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  Box covered{{kInfinite, kInfinite}, {-kInfinite, -kInfinite}, 0};
  bool crosses_limits = false;
  for (const Box& box : boxes)
    for (int k = 0; k < 2; ++k) {
      covered.low[k] = std::min(covered.low[k], std::max(box.low[k], limits.low[k]));
      covered.high[k] = std::max(covered.high[k], std::min(box.high[k], limits.high[k]));
      crosses_limits |= box.low[k] < limits.low[k] || box.high[k] > limits.high[k];
    }
  for (int k = 0; k < 2; ++k)
    if (!(covered.high[k] > covered.low[k])) {  // no image within the limits
      covered.low[k] = 0;
      covered.high[k] = 1;
    }
  constexpr double kPerEllipsoid = 32;  // cells along an axis per square root of the number of ellipsoids
  side_ = 2 + std::clamp(static_cast<int>(kPerEllipsoid * std::sqrt(static_cast<double>(boxes.size()))), 62, 2046);
  words_ = (side_ + 31) / 32;
  bits_.assign(static_cast<std::size_t>(side_) * static_cast<std::size_t>(words_), 0);
  squares_ = (side_ + kSquare - 1) / kSquare;
  if (parallel_)
    tops_.assign(static_cast<std::size_t>(squares_) * static_cast<std::size_t>(squares_),
                 -std::numeric_limits<float>::infinity());
  // Reserve the border cells for images outside the limits. kSure is a margin for rounding, kFirst the position of the
  // covered part's corner; both in cells.
  constexpr double kSure = 1e-3, kFirst = 1 + 2 * kSure;
  double cells_per_unit[2];
  for (int k = 0; k < 2; ++k) {
    cells_per_unit[k] = (side_ - 2 * kFirst) / (covered.high[k] - covered.low[k]);
    for (int c = 0; c < 4; ++c)
      maps_[k][c] = cells_per_unit[k] * maps_[k][c] + (kFirst - cells_per_unit[k] * covered.low[k]) * maps_[2][c];
  }
  const auto cell = [&](double at, int k) {
    return static_cast<int>(std::clamp(kFirst + (at - covered.low[k]) * cells_per_unit[k], 0.0, side_ - 1.0));
  };
  for (const Box& box : boxes) {
    if (box.high[0] < covered.low[0] || box.low[0] > covered.high[0] || box.high[1] < covered.low[1] ||
        box.low[1] > covered.high[1])
      continue;
    Range cells;
    for (int k = 0; k < 2; ++k) {
      cells.first[k] = cell(box.low[k] - kSure / cells_per_unit[k], k);
      cells.last[k] = cell(box.high[k] + kSure / cells_per_unit[k], k);
    }
    set(cells, box.top);
  }
  if (!crosses_limits) return;
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

std::uint32_t EllipsoidImages::may_hit(const double x[kPacket], const double y[kPacket], const double z[kPacket],
                                       std::uint32_t requested) const {
  alignas(64) std::int32_t column[kPacket];
  alignas(64) std::int32_t row[kPacket];
  alignas(64) std::uint32_t touched[kPacket];
  HWY_DYNAMIC_DISPATCH(FindCells)(maps_, side_ - 1, bits_.data(), words_, x, y, z, column, row, touched);
  std::uint32_t lanes = 0;
  for (const std::uint32_t lane : touched) lanes |= lane;
  return parallel_ ? before_tops(x, y, z, column, row, lanes & requested) : lanes & requested;
}

// Returns the touched lanes whose point is not beyond the highest ellipsoid near its cell, along the rays' direction.
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
