#include "dem/map_error/gaussian_field.h"

#include <algorithm>
#include <cmath>

#include "dem/base/noise.h"

namespace selenograph::dem {
namespace {

constexpr int kDegree = 7, kTaps = kDegree + 1;
// Distance in lattice steps at which a B-spline of degree 15, the autocorrelation of one of degree 7, falls to 1/e.
constexpr double kStepsPerLength = 1.6538;
// Odd factors that spread the lattice's indices over 64 bits.
constexpr std::uint64_t kAlongX = 0xA24BAED4963EE407u, kAlongY = 0x9FB21C651E98DF25u, kAlongZ = 0xD6E8FEB86659FD93u;

// Weights of the lattice points along an axis, and their derivatives per step; the squared weights add up to 1.
struct AxisWeights {
  double value[kTaps], slope[kTaps];
};

// Evaluates the splines at `f` steps past the cell's first point by de Boor's recursion.
AxisWeights axis_weights(double f) {
  double spline[kTaps] = {1}, lower[kTaps] = {};
  for (int degree = 1; degree <= kDegree; ++degree) {
    if (degree == kDegree) std::copy(spline, spline + kDegree, lower);
    double carried = 0;
    for (int r = 0; r < degree; ++r) {
      const double share = spline[r] / degree;
      spline[r] = carried + (r + 1 - f) * share;
      carried = (f + (degree - r - 1)) * share;
    }
    spline[degree] = carried;
  }
  AxisWeights weights;
  double square = 0, product = 0;
  for (int k = 0; k < kTaps; ++k) {
    weights.slope[k] = (k > 0 ? lower[k - 1] : 0) - (k < kDegree ? lower[k] : 0);
    square += spline[k] * spline[k];
    product += spline[k] * weights.slope[k];
  }
  const double norm = 1 / std::sqrt(square);
  for (int k = 0; k < kTaps; ++k) {
    weights.slope[k] = norm * (weights.slope[k] - spline[k] * product / square);
    weights.value[k] = norm * spline[k];
  }
  return weights;
}

// Returns a deviate of mean 0 and variance 1: the sum of the eight bytes of a hash.
double deviate(std::uint64_t hash) {
  constexpr std::uint64_t kEvenBytes = 0x00FF00FF00FF00FFu;
  const std::uint64_t pairs = (hash & kEvenBytes) + (hash >> 8 & kEvenBytes);
  const auto sum = static_cast<std::int64_t>(pairs * 0x0001000100010001u >> 48);
  constexpr double kMean = 8 * 127.5, kDeviation = 209.02153;  // sqrt(8 (256^2 - 1) / 12)
  return static_cast<double>(sum - static_cast<std::int64_t>(kMean)) * (1 / kDeviation);
}

}  // namespace

GaussianField::GaussianField(double standard_deviation, double correlation_length_m, std::uint64_t seed)
    : standard_deviation_(standard_deviation),
      correlation_length_m_(correlation_length_m),
      step_m_(correlation_length_m / kStepsPerLength),
      seed_(split_mix(seed + kSplitMixStep)) {}

void GaussianField::draw(std::int64_t x, std::int64_t y, std::int64_t z, Cursor& cursor) const {
  if (cursor.valid_ && cursor.x_ == x && cursor.y_ == y && cursor.z_ == z) return;
  cursor.valid_ = true;
  cursor.x_ = x;
  cursor.y_ = y;
  cursor.z_ = z;
  constexpr std::int64_t kFirst = -(kTaps / 2 - 1);
  for (int k = 0; k < kTaps; ++k)
    for (int j = 0; j < kTaps; ++j) {
      const std::uint64_t row = seed_ + static_cast<std::uint64_t>(z + kFirst + k) * kAlongZ +
                                static_cast<std::uint64_t>(y + kFirst + j) * kAlongY;
      for (int i = 0; i < kTaps; ++i)
        cursor.deviates_[k][j][i] = deviate(split_mix(row + static_cast<std::uint64_t>(x + kFirst + i) * kAlongX));
    }
}

GaussianField::Sample GaussianField::at(const Vec3& position_m, Cursor& cursor) const {
  const Vec3 steps = position_m / step_m_;
  const Vec3 cell(std::floor(steps.x()), std::floor(steps.y()), std::floor(steps.z()));
  draw(static_cast<std::int64_t>(cell.x()), static_cast<std::int64_t>(cell.y()), static_cast<std::int64_t>(cell.z()),
       cursor);
  const Vec3 fraction = steps - cell;
  const AxisWeights x = axis_weights(fraction.x()), y = axis_weights(fraction.y()), z = axis_weights(fraction.z());
  double value = 0;
  Vec3 gradient = Vec3::zero();
  for (int k = 0; k < kTaps; ++k) {
    double plane = 0, plane_by_x = 0, plane_by_y = 0;
    for (int j = 0; j < kTaps; ++j) {
      double row = 0, row_by_x = 0;
      for (int i = 0; i < kTaps; ++i) {
        row += x.value[i] * cursor.deviates_[k][j][i];
        row_by_x += x.slope[i] * cursor.deviates_[k][j][i];
      }
      plane += y.value[j] * row;
      plane_by_x += y.value[j] * row_by_x;
      plane_by_y += y.slope[j] * row;
    }
    value += z.value[k] * plane;
    gradient += Vec3(z.value[k] * plane_by_x, z.value[k] * plane_by_y, z.slope[k] * plane);
  }
  return {standard_deviation_ * std::clamp(value, -kMaxDeviations, kMaxDeviations),
          (standard_deviation_ / step_m_) * gradient};
}

}  // namespace selenograph::dem
