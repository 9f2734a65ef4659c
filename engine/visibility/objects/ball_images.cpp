#include "engine/visibility/objects/ball_images.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "dem/support/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/objects/ball_images.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// `maps`: of places to two coordinates in cells and what divides them, each a vector and a number. `touched`: a lane's
// own bit, or none.
void LookUp(const double (*maps)[4], double last, const std::uint32_t* bits, std::int32_t words, const double* x,
            const double* y, const double* z, std::uint32_t* touched) {
  const double *u = maps[0], *v = maps[1], *w = maps[2];
  alignas(64) std::int32_t column[kPacket], row[kPacket];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double px = x[i], py = y[i], pz = z[i], scale = 1 / (w[3] + w[0] * px + w[1] * py + w[2] * pz);
    const double across = scale * (u[3] + u[0] * px + u[1] * py + u[2] * pz),
                 down = scale * (v[3] + v[0] * px + v[1] * py + v[2] * pz);
    // So written a lane without a ray, whose numbers may be none, gets cell 0.
    const double c = across > 0 ? across : 0, r = down > 0 ? down : 0;
    column[i] = static_cast<std::int32_t>(c < last ? c : last), row[i] = static_cast<std::int32_t>(r < last ? r : last);
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

// Which triangle a ray meets is said in float, relative to an anchor: balls are larger by what that may be off.
double with_rounding(const Ball& ball, const Vec3& anchor_m) {
  return ball.radius_m + 0x1p-20 * ((ball.centre_m - anchor_m).norm() + ball.radius_m);
}

// Slopes of a ball's border along an axis; infinite where it reaches beside the place.
std::pair<double, double> slopes(double across, double forward, double radius_m) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity(), kQuarter = std::numbers::pi / 2;
  const double distance = std::hypot(across, forward);
  if (distance <= radius_m) return {-kInfinite, kInfinite};
  const double middle = std::atan2(across, forward), half = std::asin(radius_m / distance);
  const auto slope = [](double angle) {
    return angle <= -kQuarter ? -kInfinite : angle >= kQuarter ? kInfinite : std::tan(angle);
  };
  return {slope(middle - half), slope(middle + half)};
}

}  // namespace

BallImages BallImages::along(const Vec3& direction, const Vec3& anchor_m, std::span<const Ball> balls) {
  BallImages images;
  const Vec3 right = direction.unitOrthogonal(), down = direction.cross(right);
  for (int k = 0; k < 3; ++k) images.maps_[0][k] = right[k], images.maps_[1][k] = down[k];
  images.maps_[2][3] = 1;
  constexpr double kAll = std::numeric_limits<double>::infinity();
  std::vector<Box> boxes;
  for (const Ball& ball : balls) {
    const double x = right.dot(ball.centre_m), y = down.dot(ball.centre_m), reach = with_rounding(ball, anchor_m);
    boxes.push_back({{x - reach, y - reach}, {x + reach, y + reach}});
  }
  images.mark(boxes, {{-kAll, -kAll}, {kAll, kAll}});
  return images;
}

BallImages BallImages::from(const Vec3& place_m, const Eigen::Matrix3d& axes, double widest_slope,
                            std::span<const Ball> balls) {
  BallImages images;
  for (int k = 0; k < 3; ++k)
    for (int c = 0; c < 3; ++c) images.maps_[k][c] = axes(c, k);
  std::vector<Box> boxes;
  for (const Ball& ball : balls) {
    const Vec3 c = axes.transpose() * (ball.centre_m - place_m);
    const double radius_m = with_rounding(ball, place_m);
    if (c.z() <= -radius_m) continue;  // behind
    const auto [left, right] = slopes(c.x(), c.z(), radius_m);
    const auto [top, bottom] = slopes(c.y(), c.z(), radius_m);
    boxes.push_back({{left, top}, {right, bottom}});
  }
  images.mark(boxes, {{-widest_slope, -widest_slope}, {widest_slope, widest_slope}});
  return images;
}

void BallImages::mark(std::span<const Box> boxes, const Box& room) {
  constexpr double kInfinite = std::numeric_limits<double>::infinity();
  Box all{{kInfinite, kInfinite}, {-kInfinite, -kInfinite}};
  bool beyond = false;
  for (const Box& box : boxes)
    for (int k = 0; k < 2; ++k) {
      all.low[k] = std::min(all.low[k], std::max(box.low[k], room.low[k]));
      all.high[k] = std::max(all.high[k], std::min(box.high[k], room.high[k]));
      beyond |= box.low[k] < room.low[k] || box.high[k] > room.high[k];
    }
  for (int k = 0; k < 2; ++k)
    if (!(all.high[k] > all.low[k])) all.low[k] = 0, all.high[k] = 1;  // no ball's image is within the room
  constexpr double kPerBall = 16;  // cells along an axis, of the square root of the number
  side_ = 2 + std::clamp(static_cast<int>(kPerBall * std::sqrt(static_cast<double>(boxes.size()))), 62, 1022);
  words_ = (side_ + 31) / 32;
  bits_.assign(static_cast<std::size_t>(side_) * static_cast<std::size_t>(words_), 0);
  // Cells of the border are touched by what is beyond the room alone.
  constexpr double kSure = 1e-3, kFirst = 1 + 2 * kSure;  // cells
  double per_unit[2];
  for (int k = 0; k < 2; ++k) {
    per_unit[k] = (side_ - 2 * kFirst) / (all.high[k] - all.low[k]);
    for (int c = 0; c < 4; ++c)
      maps_[k][c] = per_unit[k] * maps_[k][c] + (kFirst - per_unit[k] * all.low[k]) * maps_[2][c];
  }
  const auto set = [&](int first_x, int last_x, int y) {
    for (int x = first_x; x <= last_x; ++x) bits_[static_cast<std::size_t>(y * words_ + x / 32)] |= 1U << (x % 32);
  };
  const auto cell = [&](double at, int k) {
    return static_cast<int>(std::floor(std::clamp(kFirst + (at - all.low[k]) * per_unit[k], 0.0, side_ - 1.0)));
  };
  for (const Box& box : boxes) {
    if (box.high[0] < all.low[0] || box.low[0] > all.high[0] || box.high[1] < all.low[1] || box.low[1] > all.high[1])
      continue;
    const auto first = [&](int k) { return cell(box.low[k] - kSure / per_unit[k], k); };
    const auto last = [&](int k) { return cell(box.high[k] + kSure / per_unit[k], k); };
    for (int y = first(1); y <= last(1); ++y) set(first(0), last(0), y);
  }
  if (!beyond) return;
  for (int y = 0; y < side_; ++y) set(0, y == 0 || y == side_ - 1 ? side_ - 1 : 0, y), set(side_ - 1, side_ - 1, y);
}

std::uint32_t BallImages::may_meet(const double x[kPacket], const double y[kPacket], const double z[kPacket],
                                   std::uint32_t asking) const {
  alignas(64) std::uint32_t touched[kPacket];
  HWY_DYNAMIC_DISPATCH(LookUp)(maps_, side_ - 1, bits_.data(), words_, x, y, z, touched);
  std::uint32_t lanes = 0;
  for (const std::uint32_t lane : touched) lanes |= lane;
  return lanes & asking;
}

}  // namespace selenograph::engine

#endif  // HWY_ONCE
