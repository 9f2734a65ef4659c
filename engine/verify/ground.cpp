#include "engine/verify/ground.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>

#include "dem/base/parallel.h"
#include "dem/base/quantile.h"
#include "dem/detail/features.h"
#include "dem/detail/footprints.h"
#include "dem/grid/lattice.h"

namespace selenograph::engine {
namespace {

constexpr int kPostsOfSquare = 40;            // along each side
constexpr double kShortestPublished_m = 0.5;  // published slopes are not continued to shorter baselines

// Returns latitude and longitude of the i-th place, within 45 degrees of the equator. An additive recurrence spreads
// places evenly, and the same on every machine.
std::pair<double, double> place_rad(int i) {
  const double a = std::fmod(0.5 + i * 0.7548776662466927, 1.0), b = std::fmod(0.5 + i * 0.5698402909980532, 1.0);
  return {(a - 0.5) * std::numbers::pi / 2, (b - 0.5) * 2 * std::numbers::pi};
}

// Returns the coarsest level whose blocks include an octave.
int level_showing(int octave) {
  int level = 0;
  while (level < dem::kMaxLevel && dem::Detail::smallest_octave(level) > octave) ++level;
  return level;
}

// Returns the heights at the posts of a square.
std::vector<double> square(const dem::Detail& detail, int number, double spacing_m) {
  const auto [lat, lon] = place_rad(number);
  const double lat_step = spacing_m / kMoonRadius_m, lon_step = lat_step / std::cos(lat);
  constexpr double kPerBaseline = 8;
  const int level = level_showing(static_cast<int>(std::floor(std::log2(spacing_m / kPerBaseline))));
  std::vector<double> heights(static_cast<std::size_t>(kPostsOfSquare * kPostsOfSquare));
  detail.add(dem::SquareGrid(lat, lat_step, lon, lon_step, kPostsOfSquare).grid(), level, 0, heights, {});
  return heights;
}

struct Sums {
  double craters = 0, relief = 0, clods = 0;  // sums of squared height differences
  std::vector<double> slopes{};               // absolute values
};

// Heights of a square's posts by each law alone.
struct Heights {
  std::vector<double> craters, relief, clods;
};

// Sums over all pairs of neighbouring posts of a square.
Sums sums_of(const Heights& heights, double baseline_m) {
  Sums sums;
  const auto add_pair = [&](std::size_t a, std::size_t b) {
    const double crater = heights.craters[b] - heights.craters[a], relief = heights.relief[b] - heights.relief[a],
                 clod = heights.clods[b] - heights.clods[a];
    sums.craters += crater * crater;
    sums.relief += relief * relief;
    sums.clods += clod * clod;
    sums.slopes.push_back(std::abs(crater + relief + clod) / baseline_m);
  };
  constexpr std::size_t n = kPostsOfSquare;
  for (std::size_t r = 0; r + 1 < n; ++r)
    for (std::size_t c = 0; c + 1 < n; ++c) {
      add_pair(r * n + c, r * n + c + 1);
      add_pair(r * n + c, (r + 1) * n + c);
    }
  return sums;
}

double slope_deg(double slope) { return std::atan(slope) * kDegreesPerRadian; }

}  // namespace

std::vector<SlopeRow> ground_slopes(const dem::DetailPreset& preset, int places) {
  dem::DetailPreset single_law = preset;
  single_law.relief = {};
  single_law.clods = {};
  single_law.rocks = {};
  single_law.region = {};
  const dem::Detail craters(single_law);
  single_law.craters = {};
  single_law.relief = preset.relief;
  const dem::Detail relief(single_law);
  single_law.relief = {};
  single_law.clods = preset.clods;
  const dem::Detail clods(single_law);
  std::vector<SlopeRow> rows;
  double rms_before = 0;
  for (const double baseline_m :
       {0.007, 0.014, 0.028, 0.056, 0.112, 0.5, 1.0, 2.0, 5.0, 10.0, 17.0, 50.0, 100.0, 200.0}) {
    if (baseline_m < kShortestPublished_m && !(preset.clods.cover > 0)) continue;
    std::vector<Sums> squares(static_cast<std::size_t>(places));
    in_parallel(squares.size(), [&](std::size_t i) {
      const int number = static_cast<int>(i);
      squares[i] = sums_of(
          {square(craters, number, baseline_m), square(relief, number, baseline_m), square(clods, number, baseline_m)},
          baseline_m);
    });
    Sums total;
    for (const Sums& s : squares) {
      total.craters += s.craters;
      total.relief += s.relief;
      total.clods += s.clods;
      total.slopes.insert(total.slopes.end(), s.slopes.begin(), s.slopes.end());
    }
    const double variance = total.craters + total.relief + total.clods,
                 rms_m = std::sqrt(variance / static_cast<double>(total.slopes.size()));
    const double hurst = rows.empty() ? std::numeric_limits<double>::quiet_NaN()
                                      : std::log(rms_m / rms_before) / std::log(baseline_m / rows.back().baseline_m);
    const auto share = [&](double sum) { return variance > 0 ? sum / variance : 0; };
    const bool published = preset.published && baseline_m >= kShortestPublished_m;
    rows.push_back({baseline_m, slope_deg(rms_m / baseline_m), slope_deg(median(total.slopes)), hurst,
                    share(total.craters), share(total.relief), share(total.clods),
                    slope_deg(ranked(total.slopes, total.slopes.size() * 99 / 100)),
                    published ? preset.published->at_deg(baseline_m) : std::numeric_limits<double>::quiet_NaN()});
    rms_before = rms_m;
  }
  return rows;
}

std::vector<CraterRow> ground_craters(const dem::DetailPreset& preset) {
  const dem::CraterField field(preset.craters);
  const dem::CraterAges ages(preset.craters.frequency, preset.craters.smallest_m, preset.craters.largest_m,
                             preset.craters.oldest_Ma);
  std::vector<CraterRow> rows;
  for (int k = field.smallest_octave(); k <= field.largest_octave(); ++k) {
    constexpr int kSquares = 12;
    constexpr double kDiameters = 96;
    double area_km2 = 0;
    int listed = 0, visible = 0;
    for (int i = 0; i < kSquares; ++i) {
      const auto [lat, lon] = place_rad(i);
      const double half_deg = std::ldexp(kDiameters / 2, k) / kMetresPerDegree, wide_deg = half_deg / std::cos(lat);
      const double lat_deg = lat * kDegreesPerRadian, lon_deg = lon * kDegreesPerRadian;
      const dem::Footprint box{lat_deg - half_deg, lat_deg + half_deg, lon_deg - wide_deg, lon_deg + wide_deg};
      area_km2 += dem::area_m2(box) / 1e6;
      const std::vector<dem::Crater> nearby = field.in_box(k, dem::around(box, std::ldexp(5.0, k)), {});
      for (const dem::Crater& crater : nearby) {
        if (!dem::holds(box, to_geographic(crater.centre * kMoonRadius_m)) ||
            !dem::remains_of(field, crater, nearby).any())
          continue;
        listed += crater.depth_m >= dem::Detail::kWorn * crater.diameter_m;
        visible += crater.depth_m >= dem::kVisible * crater.diameter_m;
      }
    }
    const double smallest_m = std::max(std::ldexp(1.0, k), preset.craters.smallest_m);
    rows.push_back(
        {smallest_m, 1e6 * ages.number_per_m2(smallest_m, field.largest_m(k)), listed / area_km2, visible / area_km2});
  }
  return rows;
}

std::vector<AlbedoRow> ground_albedo(const dem::DetailPreset& preset, int places) {
  if (preset.albedo_variation == 0) return {};
  constexpr std::size_t kSide = 160;
  constexpr double kBright = 1.3;
  dem::DetailPreset craters = preset;
  craters.relief = {};
  craters.clods = {};
  craters.rocks = {};
  craters.region = {};
  const dem::Detail detail(craters);
  std::vector<AlbedoRow> rows;
  for (const double pixel_m : {0.25, 1.0, 10.0}) {
    const int level = level_showing(static_cast<int>(std::ceil(std::log2(pixel_m))) + 1);
    std::vector<double> factors(static_cast<std::size_t>(places) * kSide * kSide, 1.0);
    in_parallel(static_cast<std::size_t>(places), [&](std::size_t i) {
      const auto [lat, lon] = place_rad(static_cast<int>(i));
      const double step = pixel_m / kMoonRadius_m;
      detail.add_brightness(dem::SquareGrid(lat, step, lon, step / std::cos(lat), kSide).grid(), level, 0,
                            std::span(factors).subspan(i * kSide * kSide, kSide * kSide));
    });
    double sum = 0, squares = 0;
    for (const double factor : factors) {
      sum += factor;
      squares += factor * factor;
    }
    const auto n = static_cast<double>(factors.size());
    const double mean = sum / n, soil = median(factors);
    const auto bright = std::count_if(factors.begin(), factors.end(), [&](double f) { return f > kBright * soil; });
    rows.push_back({pixel_m, mean, std::sqrt(squares / n - mean * mean), static_cast<double>(bright) / n});
  }
  return rows;
}

}  // namespace selenograph::engine
