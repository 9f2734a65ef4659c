// Bounds on the Moon's relief that are far enough from real terrain to refuse none of it:
//   heights     -9.1 to 10.8 km
//   flatness    a mare's 36 posts over 20 km span more than 4 m, over 100 km more than 20 m (slopes of 1:500 to 1:2000
//               over kilometres, and craters). Slopes in degrees, shares, counts and heights in kilometres do not.
//   steepness   at most a few per cent of slopes exceed 40 degrees at any spacing; brightness changes by far more from
//               one pixel of an image to the next
#include "dem/gdal/height_evidence.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "dem/base/error.h"
#include "dem/grid/block.h"

namespace selenograph::dem {
namespace {

// Returns the reason why ascending, distinct heights over `side_m` cannot be the Moon's in metres; empty if they may
// be.
std::string flatness_problem(const std::vector<double>& heights_m, double side_m) {
  constexpr double kFar_m = 20e3;
  constexpr double kFlattest = 2e-4;
  constexpr double kLargestShare = 100;  // upper end of slopes in degrees and shares in per cent
  constexpr double kHighest_km = 12;
  const double low = heights_m.front();
  const double high = heights_m.back();
  const bool is_near_radius_km =
      low >= (kMoonRadius_m / 1000 - kHighest_km) && high <= (kMoonRadius_m / 1000 + kHighest_km);
  const bool may_be_km = is_near_radius_km || (low >= -kHighest_km && high <= kHighest_km);
  const bool is_flat = low >= 0 && high <= kLargestShare && high - low < kFlattest * side_m;
  if (side_m < kFar_m || !(may_be_km || is_flat)) return {};
  return fmt::format(
      "its values lie between {:.4g} and {:.4g} over {:.0f} km: no terrain of the Moon is so flat. "
      "If they are kilometres, declare the unit (km) in the file",
      low, high, side_m / 1e3);
}

// Returns the reason why steps from row to row are too steep for the Moon; empty if they are not.
std::string steepness_problem(const std::vector<double>& steps_m, double spacing_m) {
  constexpr std::size_t kFewest = 18;
  constexpr double kSteepest_deg = 75;
  const double steepest_m = std::tan(kSteepest_deg * kRadiansPerDegree) * spacing_m;
  std::size_t upward = 0;
  std::size_t downward = 0;
  for (const double step_m : steps_m) {
    if (step_m > steepest_m) ++upward;
    if (step_m < -steepest_m) ++downward;
  }
  const std::size_t steep = upward + downward;
  // Accept a ramp, whose steps all go the same way: a synthetic one may be that steep.
  const bool is_ramp = 4 * std::min(upward, downward) < steep;
  if (steps_m.size() < kFewest || is_ramp || 3 * steep < 2 * steps_m.size()) return {};
  return fmt::format(
      "{} of {} steps from one row to the next, {:.4g} m away, are steeper than {} degrees: no terrain of "
      "the Moon is so steep",
      steep, steps_m.size(), spacing_m, kSteepest_deg);
}

// Returns the reason why most heights lie outside the Moon's range; empty if they do not.
std::string relief_problem(const std::vector<double>& heights_m) {
  const auto outlier_count = std::count_if(heights_m.begin(), heights_m.end(), [](double height_m) {
    return height_m < double{kLowestRelief_m} || height_m > double{kHighestRelief_m};
  });
  if (2 * static_cast<std::size_t>(outlier_count) <= heights_m.size()) return {};
  return fmt::format("its values lie between {:.6g} and {:.6g} m, and the Moon's heights between {} and {} m",
                     heights_m.front(), heights_m.back(), kLowestRelief_m, kHighestRelief_m);
}

}  // namespace

std::string_view check_words(const std::string& path, std::initializer_list<SampleWords> words,
                             std::initializer_list<std::string_view> names) {
  for (const SampleWords& about : words) {
    const std::string_view quantity = quantity_in_words(about.text);
    if (quantity == kHeights) return quantity;
    if (!quantity.empty()) throw SideRaster(path, quantity, about.origin);
  }
  for (const std::string_view name : names) {
    const std::string_view quantity = quantity_in_name(name);
    if (!quantity.empty() && quantity != kHeights) throw SideRaster(path, quantity, "its name");
  }
  return {};
}

// Tests relief, flatness and steepness; the first problem is reported.
void check_values(const RasterInfo& info, SparseHeights sparse) {
  // Accept a plain, or a raster of a few values: it is no evidence.
  constexpr std::size_t kFewestValues = 8;
  std::vector<double>& heights_m = sparse.heights_m;
  std::sort(heights_m.begin(), heights_m.end());
  heights_m.erase(std::unique(heights_m.begin(), heights_m.end()), heights_m.end());
  if (heights_m.size() < kFewestValues) return;
  std::string problem = relief_problem(heights_m);
  if (problem.empty()) problem = flatness_problem(heights_m, info.post_spacing_m * std::max(info.width, info.height));
  if (problem.empty()) problem = steepness_problem(sparse.steps_m, info.post_spacing_m);
  if (!problem.empty())
    throw NotHeights(info.path, fmt::format("does not look like heights: {}. {}", problem, kHowToDeclareHeights));
}

}  // namespace selenograph::dem
