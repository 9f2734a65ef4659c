#include "dem/detail/detail.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <numeric>
#include <ranges>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/base/quantile.h"
#include "dem/detail/detail_kernels.h"
#include "dem/grid/lattice.h"

namespace selenograph::dem {
namespace {

constexpr double kPostsPerFeature = 4;  // smallest size that a level shows, in spacings of its posts

// Returns the 99th percentile of the absolute differences from `height_m`.
double p99_from(double height_m, std::vector<double>& heights_m) {
  for (double& h : heights_m) h = std::abs(h - height_m);
  return ranked(heights_m, heights_m.size() * 99 / 100);
}

constexpr int kAny = std::numeric_limits<int>::min();

// Returns the octaves that a field has, from `first` to the one before `past`.
template <typename Field>
auto octaves_of(const Field& field, int first = kAny, int past = std::numeric_limits<int>::max()) {
  const int from = std::max(first, field.smallest_octave());
  return std::views::iota(from, std::max(from, std::min(past, field.largest_octave() + 1)));
}

// Returns the products of two lists of numbers. Empty lists stand for ones.
std::vector<double> product(std::span<const double> a, std::span<const double> b) {
  std::vector<double> out(a.empty() ? b.begin() : a.begin(), a.empty() ? b.end() : a.end());
  if (!a.empty() && !b.empty()) std::transform(out.begin(), out.end(), b.begin(), out.begin(), std::multiplies<>());
  return out;
}

}  // namespace

double PublishedSlopes::at_deg(double other_baseline_m) const {
  const double slope =
      std::tan(median_slope_deg * kRadiansPerDegree) * std::pow(other_baseline_m / baseline_m, hurst - 1);
  return std::atan(slope) * kDegreesPerRadian;
}

int Detail::smallest_octave(int level) {
  return static_cast<int>(std::ceil(std::log2(kPostsPerFeature * post_spacing_m(level)) - 1e-9));
}

Detail::Detail(const DetailPreset& preset)
    : preset_(preset),
      craters_(preset.craters),
      brightness_(craters_, preset.albedo_variation),
      relief_(preset.relief),
      clods_(preset.clods, preset.region),
      fragments_(preset.rocks, preset.region),
      rocks_(preset.rocks, preset.region),
      fade_m_(std::max({preset.craters.largest_m, preset.relief.longest_m, preset.clods.largest_m})) {
  // Measure the mean of each octave of craters, and each octave's 99th percentile, alone on a square of ground. The
  // fields have no region here, so that the square is full; craters_ gets its region below.
  constexpr int kSide = 192;
  // Measures the octaves of a field by `add`, in parallel. `mean_m`: the mean of an octave's heights, from which the
  // percentile is counted.
  const auto measure = [&](const auto& field, const auto& add, const auto& mean_m) {
    const auto octaves = octaves_of(field);
    std::vector<double> p99_m(octaves.size());
    in_parallel(p99_m.size(), [&](std::size_t i) {
      const int octave = octaves[static_cast<int>(i)];
      // The square measures 64 diameters or wavelengths and lies at the equator, where a grid is square.
      const double step = std::ldexp(64.0, octave) / kSide / kMoonRadius_m;
      std::vector<double> heights(kSide * kSide);
      add(SquareGrid(0, step, 1, step, kSide).grid(), octave, heights);
      p99_m[i] = p99_from(mean_m(i, heights), heights);
    });
    return p99_m;
  };
  const auto none = [](std::size_t, const std::vector<double>&) { return 0.0; };
  means_m_.assign(octaves_of(craters_).size(), 0);
  crater_p99_m_ = measure(
      craters_,
      [&](const DirectionGrid& grid, int octave, std::span<double> heights_m) {
        add_craters(grid, octave, {}, heights_m, {}, {});
      },
      [&](std::size_t i, const std::vector<double>& heights_m) {
        return means_m_[i] = std::accumulate(heights_m.begin(), heights_m.end(), 0.0) / (kSide * kSide);
      });
  relief_p99_m_ = measure(
      relief_,
      [&](const DirectionGrid& grid, int octave, std::span<double> heights_m) {
        add_relief(grid, octave, {}, heights_m, {});
      },
      none);
  // Returns an `add` of a field that marks what it covers.
  const auto unmarked = [](const auto& field) {
    return [&field](const DirectionGrid& grid, int octave, std::span<double> heights_m) {
      field.add(grid, octave, {}, heights_m, {}, {});
    };
  };
  const ClodField clods_everywhere(preset.clods);
  clod_p99_m_ = measure(clods_everywhere, unmarked(clods_everywhere), none);
  const FragmentField fragments_everywhere(preset.rocks);
  fragment_p99_m_ = measure(fragments_everywhere, unmarked(fragments_everywhere), none);
  craters_ = CraterField(preset.craters, preset.region);
  finest_level_ = find_finest_level();
}

double Detail::expected_left_out_m(double size_m) const {
  double square_m2 = 0;  // sum over octaves of the squared percentile
  const auto add = [&](const std::vector<double>& p99_m, int smallest_octave) {
    for (std::size_t i = 0; i < p99_m.size(); ++i)
      if (std::ldexp(1.0, smallest_octave + static_cast<int>(i)) < size_m) square_m2 += p99_m[i] * p99_m[i];
  };
  add(crater_p99_m_, craters_.smallest_octave());
  add(relief_p99_m_, relief_.smallest_octave());
  add(clod_p99_m_, clods_.smallest_octave());
  add(fragment_p99_m_, fragments_.smallest_octave());
  return std::sqrt(square_m2);
}

int Detail::samples_per_cell(int octave, int posts_level) {
  constexpr int kMinSamples = 8;
  constexpr double kDiametersApart = 0.6;
  return std::max(kMinSamples,
                  static_cast<int>(std::ceil(post_spacing_m(posts_level) / std::ldexp(kDiametersApart, octave))));
}

// The constructor stores the result, because every block of every frame needs it.
int Detail::find_finest_level() const {
  int level = 0;
  const auto shows_all_of = [&](const auto& field) {
    return octaves_of(field).empty() || smallest_octave(level) <= field.smallest_octave();
  };
  while (level < kMaxLevel &&
         !(shows_all_of(craters_) && shows_all_of(relief_) && shows_all_of(clods_) && shows_all_of(fragments_)))
    ++level;
  return level;
}

double Detail::mean_m(int octave) const {
  return means_m_[static_cast<std::size_t>(octave - craters_.smallest_octave())];
}

double Detail::left_out_m(int level, int posts_level) const {
  double sum_m = 0;
  // Octaves below this one are missing on the level, and the posts do not have them either.
  const int shown = std::min(smallest_octave(level), past_largest_octave(posts_level));
  for (const int k : octaves_of(craters_, kAny, shown))
    // An octave's heights, less its mean, lie between -(deepest + mean) and highest - mean.
    sum_m +=
        std::max({craters_.deepest_m(k) + mean_m(k), craters_.highest_m(k) - mean_m(k),
                  preset_.region.everywhere() ? 0 : craters_.deepest_m(k)});  // beside the border the mean has faded
  for (const int k : octaves_of(relief_, kAny, shown)) sum_m += relief_.max_height_m(k);
  for (const int k : octaves_of(clods_, kAny, shown)) sum_m += clods_.max_height_m(k);
  for (const int k : octaves_of(fragments_, kAny, shown)) sum_m += fragments_.max_height_m(k);
  return sum_m;
}

double Detail::left_out_size_m(int octave) const {
  const auto has_smaller = [&](const auto& field) { return !octaves_of(field, kAny, octave).empty(); };
  return has_smaller(craters_) || has_smaller(relief_) || has_smaller(clods_) || has_smaller(fragments_)
             ? std::min(std::ldexp(1.0, octave), widest_m())
             : 0;
}

// Adds up the ranges of all octaves that detail may have.
double Detail::max_detail_m(int posts_level) const {
  // Detail lies within a range, and so do its means over cells. Sharpening (mean_correction.h) can amplify a mean's
  // distance from the middle of the range by 2.557, the sum of its weights' absolute values over both axes.
  // Interpolation between posts can amplify it by 1.5625 more, the sum of Catmull-Rom's.
  constexpr double kMaxOverRange = (1 + 1.5625 * 2.557) / 2;  // |detail - correction| over the range
  const int first_in_means = smallest_octave(posts_level + kCellLevels), past = past_largest_octave(posts_level);
  double range_m = 0;
  const bool fades = !preset_.region.everywhere();  // the means, not what they are of
  for (const int k : octaves_of(craters_, first_in_means, past))
    range_m += craters_.deepest_m(k) + craters_.highest_m(k) + (fades ? std::abs(mean_m(k)) : 0);
  for (const int k : octaves_of(relief_, first_in_means, past)) range_m += 2 * relief_.max_height_m(k);
  for (const int k : octaves_of(clods_, first_in_means, past))
    range_m += clods_.max_height_m(k) + (fades ? clods_.mean_m(k) : 0);
  for (const int k : octaves_of(fragments_, first_in_means, past))
    range_m += fragments_.max_height_m(k) + (fades ? fragments_.mean_m(k) : 0);
  // Add the octaves that are too small for the means: nothing of them is subtracted.
  return kMaxOverRange * range_m + left_out_m(posts_level + kCellLevels, posts_level);
}

// Evaluates an octave from the oldest crater to the youngest, each row by row:
//
//     heights   ___          ____     each crater replaces what the older ones left (cast_crater):
//   1st crater     \__    __/         wholly inside its rim, less and less towards its reach
//   2nd crater    __  \_/ \_/
//
// The octave's mean is subtracted in the end, weighted by `shares` (empty: 1 everywhere).
void Detail::add_craters(const DirectionGrid& grid, int octave, std::span<const double> shares,
                         std::span<double> heights_m, std::span<float> in_crater, const StopToken& stop) const {
  const BoundingBall ball = ball_around(grid);
  std::vector<Crater> craters;
  craters_.near(octave, ball.direction, ball.radius_m, craters, stop);
  std::sort(craters.begin(), craters.end(), formed_before);
  constexpr double kSteps = CraterShape::kStepsPerRadius;
  std::vector<float> heights(grid.rows() * grid.columns(), 0.F), profile_m;
  for (const Crater& crater : craters) {
    stop.check();
    const double reach = CraterShape::reach(crater.age);
    const CraterShape::Profile shape = craters_.shape().profile(crater.age);
    profile_m.resize(static_cast<std::size_t>(reach * kSteps) + 3);
    const auto older = static_cast<float>(shape.share * crater.scale),
               younger = static_cast<float>((1 - shape.share) * crater.scale);
    for (std::size_t i = 0; i < profile_m.size(); ++i)
      profile_m[i] = younger * shape.younger[i] + older * shape.older[i];
    const CraterProfile profile{profile_m.data(), 1 / ((reach - CraterShape::kReplaces) * kSteps), kSteps};
    const bool marked = !in_crater.empty() && crater.depth_m >= kWorn * crater.diameter_m;
    visit_rows_under(crater, reach, kSteps, grid,
                     [&](const CraterOverRow& over_row, const RowUnderCrater& row, std::size_t first_post) {
                       cast_crater(over_row, row, profile, heights.data() + first_post,
                                   marked ? in_crater.data() + first_post : nullptr);
                     });
  }
  const double mean = mean_m(octave);
  for (std::size_t i = 0; i < heights_m.size(); ++i)
    heights_m[i] += static_cast<double>(heights[i]) - (shares.empty() ? mean : shares[i] * mean);
}

bool Detail::has_relief(int level, int posts_level) const {
  return !octaves_of(relief_, smallest_octave(level), past_largest_octave(posts_level)).empty();
}

void Detail::add(const DirectionGrid& grid, int level, int posts_level, std::span<double> heights_m, const Marks& marks,
                 const StopToken& stop, std::span<const double> relief_factor) const {
  std::fill(marks.in_crater.begin(), marks.in_crater.end(), 0.F);
  std::fill(marks.on_clod.begin(), marks.on_clod.end(), 0.F);
  std::fill(marks.fragments.on_fragment.begin(), marks.fragments.on_fragment.end(), 0.F);
  const std::vector<double> shares = shares_of(grid), weights = product(relief_factor, shares);
  const int shown = smallest_octave(level), past = past_largest_octave(posts_level);
  for (const int k : octaves_of(craters_, shown, past)) add_craters(grid, k, shares, heights_m, marks.in_crater, stop);
  for (const int k : octaves_of(relief_, shown, past))
    add_relief(grid, k, relief_.follows_posts(k) ? weights : shares, heights_m, stop);
  for (const int k : octaves_of(clods_, shown, past)) clods_.add(grid, k, shares, heights_m, marks.on_clod, stop);
  for (const int k : octaves_of(fragments_, shown, past))
    fragments_.add(grid, k, shares, heights_m, marks.fragments, stop);
}

void Detail::add_crater_brightness(const DirectionGrid& grid, int level, int posts_level, std::span<double> factor,
                                   const StopToken& stop) const {
  if (brightness_.none()) return;
  const std::vector<double> shares = shares_of(grid);
  const int shown = smallest_octave(level), past = past_largest_octave(posts_level);
  constexpr double kUnshownWeight = 0.5;
  for (const int k : octaves_of(craters_, shown - 1, past))
    brightness_.add(craters_, grid, k, shares, factor, stop, k < shown ? kUnshownWeight : 1);
}

void Detail::add_octave(const DirectionGrid& grid, int octave, std::span<double> heights_m, const StopToken& stop,
                        std::span<const double> relief_factor) const {
  const std::vector<double> shares = shares_of(grid);
  const auto has = [&](const auto& field) { return !octaves_of(field, octave, octave + 1).empty(); };
  if (has(craters_)) add_craters(grid, octave, shares, heights_m, {}, stop);
  if (has(relief_))
    add_relief(grid, octave, relief_.follows_posts(octave) ? product(relief_factor, shares) : shares, heights_m, stop);
  if (has(clods_)) clods_.add(grid, octave, shares, heights_m, {}, stop);
  if (has(fragments_)) fragments_.add(grid, octave, shares, heights_m, {}, stop);
}

// Adds an octave of relief, multiplied by `weights` (empty: 1 everywhere).
void Detail::add_relief(const DirectionGrid& grid, int octave, std::span<const double> weights,
                        std::span<double> heights_m, const StopToken& stop) const {
  std::vector<double> row_m(weights.empty() ? 0 : grid.columns());
  for (std::size_t r = 0; r < grid.rows(); stop.check(), ++r) {
    const auto row = heights_m.subspan(r * grid.columns(), grid.columns());
    if (weights.empty()) {
      relief_.add_row(octave, grid, r, row);
      continue;
    }
    // Multiply at every position, also where the weight is 1, so that adjacent blocks agree to the bit.
    std::fill(row_m.begin(), row_m.end(), 0.0);
    relief_.add_row(octave, grid, r, row_m);
    for (std::size_t c = 0; c < row.size(); ++c) row[c] += weights[r * grid.columns() + c] * row_m[c];
  }
}

std::vector<double> Detail::shares_of(const DirectionGrid& grid) const {
  std::vector<double> shares;
  if (preset_.region.everywhere()) return shares;
  const BoundingBall ball = ball_around(grid);
  const double depth_inside_m = preset_.region.inside_m(ball.direction.normalized());  // negative outside
  constexpr double kMarginFactor = 1.01;  // covers the use of chords for arcs, and rounding
  // Skip the evaluation per position for a ball clear of the border and of the fade inside it: it would give exactly 0
  // or 1 everywhere.
  if (std::abs(depth_inside_m) > kMarginFactor * ball.radius_m + fade_m_) {
    shares.assign(grid.rows() * grid.columns(), depth_inside_m > 0 ? 1 : 0);
    return shares;
  }
  for (std::size_t r = 0; r < grid.rows(); ++r)
    for (std::size_t c = 0; c < grid.columns(); ++c)
      shares.push_back(
          share(Vec3(grid.cos_lat[r] * grid.cos_lon[c], grid.cos_lat[r] * grid.sin_lon[c], grid.sin_lat[r])));
  return shares;
}

// A crater, a clod or a fragment whose centre lies inside the region may reach beyond its border.
bool Detail::reaches(const Vec3& direction, double radius_m) const {
  const double beyond_m = std::max({CraterShape::reach(CraterShape::kOldest) * preset_.craters.largest_m,
                                    preset_.clods.largest_m, fragments_.empty() ? 0 : preset_.rocks.smallest_m}) /
                          2;
  return preset_.region.inside_m(direction) > -(radius_m + beyond_m);
}

}  // namespace selenograph::dem
