#include "dem/detail/crater_visibility.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>

#include "dem/base/parallel.h"
#include "dem/detail/direction_grid.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {
namespace {

using std::numbers::pi;

// Side of a square of ground and steps, in smallest diameters of the octave. A circle of the smallest diameter has a
// radius of four steps.
constexpr int kSquareDiameters = 32, kStepsPerDiameter = 8, kSquarePosts = kSquareDiameters * kStepsPerDiameter + 1;
// Middles of the squares, degrees, away from the coordinate planes of the relief's lattice.
struct Middle {
  double lat_deg, lon_deg;
};
constexpr std::array<Middle, 4> kMiddles{{{-41.3, -117.7}, {-13.9, 31.1}, {17.3, 101.9}, {37.1, -51.7}}};
constexpr int kRingSamples = 16, kMiddlePost = kSquarePosts / 2;

// Returns the heights of one octave alone, or of its relief, on a square, row by row.
std::vector<double> heights_of(const Detail& detail, int octave, bool relief_only, const Middle& middle,
                               const StopToken& stop) {
  const double step = std::ldexp(1.0, octave) / kStepsPerDiameter / kMoonRadius_m,
               south = middle.lat_deg * kRadiansPerDegree - step * kMiddlePost,
               lon_step = step / std::cos(middle.lat_deg * kRadiansPerDegree),
               west = middle.lon_deg * kRadiansPerDegree - lon_step * kMiddlePost;
  std::vector<double> heights(static_cast<std::size_t>(kSquarePosts) * kSquarePosts);
  const SquareGrid square(south, step, west, lon_step, kSquarePosts);
  if (!relief_only) {
    detail.add_octave(square.grid(), octave, heights, stop);
    return heights;
  }
  for (std::size_t r = 0; r < kSquarePosts; ++r)
    detail.relief().add_row(octave, square.grid(), r, std::span(heights).subspan(r * kSquarePosts, kSquarePosts));
  return heights;
}

// Interpolates heights at a fractional row and column of a square.
double bilinear(const std::vector<double>& heights, double row, double column) {
  const auto r = static_cast<std::size_t>(row), c = static_cast<std::size_t>(column);
  const double y = row - static_cast<double>(r), x = column - static_cast<double>(c);
  const double* at = &heights[r * kSquarePosts + c];
  return std::lerp(std::lerp(at[0], at[1], x), std::lerp(at[kSquarePosts], at[kSquarePosts + 1], x), y);
}

// Returns the mean square of (mean height on a ring - height at its centre) over a grid of ring centres, spaced half
// the octave's smallest diameter. `radius` is in steps.
double mean_square(const std::vector<double>& heights, int radius) {
  std::array<double, kRingSamples> row_offset{}, column_offset{};
  for (std::size_t i = 0; i < kRingSamples; ++i) {
    const double angle = 2 * pi * (static_cast<double>(i) + 0.5) / kRingSamples;
    row_offset[i] = radius * std::cos(angle);
    column_offset[i] = radius * std::sin(angle);
  }
  double sum = 0;
  int rings = 0;
  for (int r = radius; r < kSquarePosts - radius; r += kStepsPerDiameter / 2)
    for (int c = radius; c < kSquarePosts - radius; c += kStepsPerDiameter / 2, ++rings) {
      double ring_sum_m = 0;
      for (std::size_t i = 0; i < kRingSamples; ++i)
        ring_sum_m += bilinear(heights, r + row_offset[i], c + column_offset[i]);
      const double ring_minus_centre_m =
          ring_sum_m / kRingSamples - heights[static_cast<std::size_t>(r) * kSquarePosts + static_cast<std::size_t>(c)];
      sum += ring_minus_centre_m * ring_minus_centre_m;
    }
  return sum / rings;
}

// Returns a detail with the same laws everywhere, since the squares above may lie outside the detail's region.
std::unique_ptr<const Detail> everywhere(const Detail& detail) {
  DetailPreset preset = detail.preset();
  preset.region = {};
  return std::make_unique<const Detail>(preset);
}

}  // namespace

CraterRoughness::Octave CraterRoughness::measured(const Detail& detail, int octave, const StopToken& stop) {
  Octave sums;
  for (const Middle& middle : kMiddles) {
    const auto add = [&](Squares& squares, bool relief_only) {
      const std::vector<double> heights = heights_of(detail, octave, relief_only, middle, stop);
      for (int i = 0; i < kDiameters; ++i)
        squares[static_cast<std::size_t>(i)] += mean_square(heights, kStepsPerDiameter / 4 << i) / kMiddles.size();
    };
    add(sums.total, false);
    if (detail.relief().follows_posts(octave)) add(sums.relief, true);
  }
  return sums;
}

CraterRoughness::CraterRoughness(const Detail& detail, const StopToken& stop) {
  std::unique_ptr<const Detail> copy;
  if (!detail.preset().region.everywhere()) copy = everywhere(detail);
  const Detail& measure = copy ? *copy : detail;
  const CraterField& craters = measure.craters();
  const Relief& relief = measure.relief();
  smallest_ = std::min(craters.smallest_octave(), relief.smallest_octave());
  if (const ClodField& clods = measure.clods(); clods.smallest_octave() <= clods.largest_octave())
    smallest_ = std::min(smallest_, clods.smallest_octave());
  if (!measure.fragments().empty()) smallest_ = std::min(smallest_, measure.fragments().smallest_octave());
  smallest_ = std::max(smallest_, Detail::smallest_octave(kMaxLevel));
  const int largest = std::min(std::max(craters.largest_octave(), relief.largest_octave()),
                               Detail::past_largest_octave(kRootLevel) - 1);
  octaves_.resize(static_cast<std::size_t>(std::max(0, largest - smallest_ + 1)));
  in_parallel(octaves_.size(),
              [&](std::size_t i) { octaves_[i] = measured(measure, smallest_ + static_cast<int>(i), stop); });
}

// Relief is independent of the rest of its octave, so their mean squares add up, too.
double CraterRoughness::mean_square_m2(int octave, double diameter_m, double relief_factor) const {
  if (octave < smallest_octave() || octave > largest_octave()) return 0;
  const Octave& squares = octaves_[static_cast<std::size_t>(octave - smallest_)];
  const double diameters = diameter_m / std::ldexp(0.5, octave);
  return std::max(0.0,
                  at(squares.total, diameters) - (1 - relief_factor * relief_factor) * at(squares.relief, diameters));
}

// Interpolates a table of diameters from half the octave's smallest on, doubling. On smaller rings the ground is a
// paraboloid, whose difference from its centre grows with the square of the diameter.
double CraterRoughness::at(const Squares& squares, double ratio) {
  if (ratio <= 1) return squares.front() * std::pow(ratio, 4);
  const double index = std::log2(ratio);
  const auto below = static_cast<std::size_t>(index);
  if (below + 1 >= squares.size()) return squares.back();
  return std::lerp(squares[below], squares[below + 1], index - static_cast<double>(below));
}

}  // namespace selenograph::dem
