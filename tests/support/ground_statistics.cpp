#include "tests/support/ground_statistics.h"

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

namespace selenograph::test {
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
  double craters = 0, relief = 0, clods = 0, fragments = 0;  // sums of squared height differences
  std::vector<double> slopes{};                              // absolute values
};

// Heights of a square's posts by each law alone.
struct Heights {
  std::vector<double> craters, relief, clods, fragments;
};

// Sums over all pairs of neighbouring posts of a square.
Sums sums_of(const Heights& heights, double baseline_m) {
  Sums sums;
  const auto add_pair = [&](std::size_t a, std::size_t b) {
    const auto difference = [&](const std::vector<double>& heights_m) { return heights_m[b] - heights_m[a]; };
    const double crater = difference(heights.craters), relief = difference(heights.relief);
    const double clod = difference(heights.clods), fragment = difference(heights.fragments);
    sums.craters += crater * crater;
    sums.relief += relief * relief;
    sums.clods += clod * clod;
    sums.fragments += fragment * fragment;
    sums.slopes.push_back(std::abs(crater + relief + clod + fragment) / baseline_m);
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

// The laws of a preset, one by one, everywhere.
struct SingleLaws {
  explicit SingleLaws(const dem::DetailPreset& preset)
      : craters(only(preset, &dem::DetailPreset::craters)),
        relief(only(preset, &dem::DetailPreset::relief)),
        clods(only(preset, &dem::DetailPreset::clods)),
        fragments(only(preset, &dem::DetailPreset::rocks)) {}
  dem::Detail craters, relief, clods, fragments;
  Heights heights(int number, double spacing_m) const {
    return {square(craters, number, spacing_m), square(relief, number, spacing_m), square(clods, number, spacing_m),
            square(fragments, number, spacing_m)};
  }

 private:
  template <typename Law>
  static dem::DetailPreset only(const dem::DetailPreset& preset, Law dem::DetailPreset::*law) {
    dem::DetailPreset single;
    single.*law = preset.*law;
    return single;
  }
};

// Returns a square box around place number i, and its area.
std::pair<dem::Footprint, double> box_at(int i, double side_m) {
  const auto [lat, lon] = place_rad(i);
  const double half_deg = side_m / 2 / kMetresPerDegree, wide_deg = half_deg / std::cos(lat);
  const double lat_deg = lat * kDegreesPerRadian, lon_deg = lon * kDegreesPerRadian;
  const dem::Footprint box{lat_deg - half_deg, lat_deg + half_deg, lon_deg - wide_deg, lon_deg + wide_deg};
  return {box, dem::area_m2(box)};
}

// Returns the area of circles of rocks between two diameters over the ground's, by a law.
double cover_by(const dem::SizeFrequency& law, double smallest_m, double largest_m) {
  constexpr int kSizes = 64;
  const double ratio = std::pow(largest_m / smallest_m, 1.0 / kSizes);
  double cover = 0;
  for (int i = 0; i < kSizes; ++i) {
    const double low_m = smallest_m * std::pow(ratio, i);
    cover += law.between(low_m, low_m * ratio) * std::numbers::pi / 4 * low_m * low_m * ratio;
  }
  return cover;
}

}  // namespace

std::vector<SlopeRow> ground_slopes(const dem::DetailPreset& preset, std::span<const double> baselines_m, int places) {
  const SingleLaws laws(preset);
  std::vector<SlopeRow> rows;
  double rms_before = 0;
  for (const double baseline_m : baselines_m) {
    std::vector<Sums> squares(static_cast<std::size_t>(places));
    in_parallel(squares.size(), [&](std::size_t i) {
      squares[i] = sums_of(laws.heights(static_cast<int>(i), baseline_m), baseline_m);
    });
    Sums total;
    for (const Sums& s : squares) {
      total.craters += s.craters;
      total.relief += s.relief;
      total.clods += s.clods;
      total.fragments += s.fragments;
      total.slopes.insert(total.slopes.end(), s.slopes.begin(), s.slopes.end());
    }
    const double variance = total.craters + total.relief + total.clods + total.fragments,
                 rms_m = std::sqrt(variance / static_cast<double>(total.slopes.size()));
    const double hurst = rows.empty() ? std::numeric_limits<double>::quiet_NaN()
                                      : std::log(rms_m / rms_before) / std::log(baseline_m / rows.back().baseline_m);
    const auto share = [&](double sum) { return variance > 0 ? sum / variance : 0; };
    rows.push_back({baseline_m, slope_deg(rms_m / baseline_m), slope_deg(median(total.slopes)), hurst,
                    share(total.craters), share(total.relief), share(total.clods), share(total.fragments),
                    slope_deg(ranked(total.slopes, total.slopes.size() * 99 / 100)),
                    baseline_m < kShortestPublished_m ? std::numeric_limits<double>::quiet_NaN()
                                                      : preset.published.value().at_deg(baseline_m)});
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
    double area_km2 = 0, depths = 0;
    int listed = 0, visible = 0;
    for (int i = 0; i < kSquares; ++i) {
      const auto [box, area_m2] = box_at(i, std::ldexp(kDiameters, k));
      area_km2 += area_m2 / 1e6;
      const std::vector<dem::Crater> nearby = field.in_box(k, dem::around(box, std::ldexp(5.0, k)), {});
      for (const dem::Crater& crater : nearby) {
        if (!dem::holds(box, to_geographic(crater.centre * kMoonRadius_m)) ||
            !dem::remains_of(field, crater, nearby).any())
          continue;
        listed += crater.depth_m >= dem::Detail::kWorn * crater.diameter_m;
        if (crater.depth_m < dem::kVisible * crater.diameter_m) continue;
        ++visible;
        depths += crater.depth_m / crater.diameter_m;
      }
    }
    const double smallest_m = std::max(std::ldexp(1.0, k), preset.craters.smallest_m);
    rows.push_back({smallest_m, 1e6 * ages.number_per_m2(smallest_m, field.largest_m(k)), listed / area_km2,
                    visible / area_km2, depths / visible});
  }
  return rows;
}

std::vector<RockRow> ground_rocks(const dem::DetailPreset& preset) {
  dem::RockLaw law = preset.rocks;
  law.on_ejecta = 1;
  const dem::RockField rocks(law);
  if (rocks.empty()) return {};
  const dem::FragmentField fragments(law);
  std::vector<RockRow> rows;
  for (int k = fragments.empty() ? rocks.smallest_octave() : fragments.smallest_octave(); k <= rocks.largest_octave();
       ++k) {
    // Some thousand rocks: their area scatters by a twentieth.
    constexpr int kBoxes = 12;
    constexpr double kDiameters = 1000;
    double ground_m2 = 0, rocks_m2 = 0, fragments_m2 = 0;
    for (int i = 0; i < kBoxes; ++i) {
      const auto [box, area_m2] = box_at(i, std::ldexp(kDiameters, k));
      ground_m2 += area_m2;
      std::vector<dem::Rock> found;
      if (k >= rocks.smallest_octave()) rocks.in_box(k, box, {}, found);
      for (const dem::Rock& rock : found) rocks_m2 += std::numbers::pi / 4 * rock.diameter_m * rock.diameter_m;
      if (k <= fragments.largest_octave()) fragments_m2 += fragments.area_m2(k, box);
    }
    const double first_m = law.smallest_fragment_m > 0 ? law.smallest_fragment_m : law.smallest_m;
    const double smallest_m = std::max(std::ldexp(1.0, k), first_m);
    rows.push_back({smallest_m, cover_by(law.frequency, smallest_m, rocks.largest_m(k)),
                    (rocks_m2 + fragments_m2) / ground_m2, fragments_m2 / ground_m2});
  }
  return rows;
}

RoughnessRow ground_roughness(const dem::DetailPreset& preset, int places) {
  constexpr double kWindow_m = 0.125;
  const SingleLaws laws(preset);
  std::vector<double> about_mean_m(static_cast<std::size_t>(places)), about_plane_m(about_mean_m.size());
  in_parallel(about_plane_m.size(), [&](std::size_t window) {
    const Heights heights = laws.heights(static_cast<int>(window), kWindow_m / kPostsOfSquare);
    // Sums over the window of heights, of their squares, and of their products with both coordinates.
    double sum = 0, squares = 0, along_x = 0, along_y = 0, coordinate_squares = 0;
    for (int r = 0; r < kPostsOfSquare; ++r)
      for (int c = 0; c < kPostsOfSquare; ++c) {
        const auto i = static_cast<std::size_t>(r * kPostsOfSquare + c);
        const double height_m = heights.craters[i] + heights.relief[i] + heights.clods[i] + heights.fragments[i];
        const double x = c - (kPostsOfSquare - 1) / 2.0, y = r - (kPostsOfSquare - 1) / 2.0;
        sum += height_m;
        squares += height_m * height_m;
        along_x += x * height_m;
        along_y += y * height_m;
        coordinate_squares += x * x;
      }
    constexpr double kPosts = kPostsOfSquare * kPostsOfSquare;
    const double variance = squares / kPosts - sum / kPosts * (sum / kPosts);
    const double of_plane = (along_x * along_x + along_y * along_y) / (coordinate_squares * kPosts);
    about_mean_m[window] = std::sqrt(std::max(0.0, variance));
    about_plane_m[window] = std::sqrt(std::max(0.0, variance - of_plane));
  });
  const auto percentile = [&](std::size_t percent) {
    return ranked(about_plane_m, (about_plane_m.size() - 1) * percent / 100);
  };
  return {kWindow_m, percentile(50), percentile(5), percentile(95), median(about_mean_m)};
}

std::vector<AlbedoRow> ground_albedo(const dem::DetailPreset& preset, int places) {
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
      detail.add_crater_brightness(dem::SquareGrid(lat, step, lon, step / std::cos(lat), kSide).grid(), level, 0,
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

}  // namespace selenograph::test
