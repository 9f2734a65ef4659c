// Terrain detail finer than the posts: craters, relief, clods and fragments added to heights, level by level.
//
// A level shows an octave of craters when the spacing of its posts is at most a quarter of the octave's smallest
// diameter, and an octave of relief when it is at most a quarter of its wavelength. A level shows its octaves exactly:
// the height at a vertex is a function of position, preset and level. Posts of a DEM get octaves of up to about twice
// their spacing; larger features are in the posts themselves:
//
//   level   post spacing   octaves k of sizes [2^k, 2^(k+1)) m, over posts of level 8
//     8        118 m       posts                   32    64   128   256 m   ... resolved by the posts
//     9         59 m       none                     |     |     |     |
//    10         30 m       7                        |     |     |==7==|
//    11         15 m       6, 7                     |     |==6==|==7==|
//    12        7.4 m       5, 6, 7                  |==5==|==6==|==7==|
//
// Craters of one octave are not summed: in the order of their ages each replaces the ground that older ones left,
// wholly inside, smoothly less towards its reach. The contribution of an octave is therefore bounded for any
// population, and so is what a level omits; only a fresh rim is sharp.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/clod_field.h"
#include "dem/detail/crater_brightness.h"
#include "dem/detail/crater_field.h"
#include "dem/detail/direction_grid.h"
#include "dem/detail/fragment_field.h"
#include "dem/detail/region.h"
#include "dem/detail/relief.h"
#include "dem/detail/rock_field.h"

namespace selenograph::dem {

// Published slopes of the ground that a preset imitates: the median over a baseline, and the Hurst exponent by which
// deviations grow with the baseline.
struct PublishedSlopes {
  double median_slope_deg = 0, baseline_m = 0, hurst = 0;
  // Median slope over another baseline, degrees.
  double at_deg(double baseline_m) const;
};

// Says where a law of a preset was measured, and what is extrapolated beyond that.
struct LawSource {
  std::string law;  // a member of the preset: "craters", "relief", "clods" or "rocks"
  std::string measured, extrapolated;
};

struct DetailPreset {
  std::uint64_t fingerprint = 0;  // hash of the preset's source text
  CraterLaw craters;
  ReliefLaw relief;
  ClodLaw clods;
  RockLaw rocks;
  double albedo_variation = 0;  // of craters and rocks; 0: none, 1: as described in crater_brightness.h
  Region region;                // area that has the detail
  std::optional<PublishedSlopes> published;
  std::vector<LawSource> sources;
};

// Thread-safe: const functions may be called concurrently.
class Detail {
 public:
  explicit Detail(const DetailPreset& preset);

  const DetailPreset& preset() const { return preset_; }
  // The coarsest level that shows all octaves.
  int finest_level() const { return finest_level_; }
  // Smallest octave of craters, and of relief, that a level shows: octave k has sizes from 2^k to 2^(k+1) m.
  static int smallest_octave(int level);

  // Marks the features at the positions of a grid. A span may be empty.
  struct Marks {
    std::span<float> in_crater;  // 1 inside the rim of a crater at least kWorn deep, else 0
    std::span<float> on_clod;    // 1 or 0
    FragmentField::Marks fragments;
  };
  // Adds to heights in metres, row by row, the octaves that a level shows and `posts_level`, the level of the DEM's
  // posts there, does not. The result at a position does not depend on the grid, to the bit. `relief_factor`: of the
  // amplitudes of relief that follow the posts, by position, from the law's min_factor to 1; empty: 1 everywhere.
  void add(const DirectionGrid& grid, int level, int posts_level, std::span<double> heights_m, const Marks& marks,
           const StopToken& stop = {}, std::span<const double> relief_factor = {}) const;
  // Depth over diameter below which a crater is no longer recognised.
  static constexpr double kWorn = 0.02;
  // Adds one octave; it must not be among those that the posts' level shows.
  void add_octave(const DirectionGrid& grid, int octave, std::span<double> heights_m, const StopToken& stop = {},
                  std::span<const double> relief_factor = {}) const;
  // Adds to factors of the albedo, row by row, what craters of the octaves that add() adds to the heights change, and
  // the octave below them by half, as bright ground around a crater is wider than the crater.
  void add_crater_brightness(const DirectionGrid& grid, int level, int posts_level, std::span<double> factor,
                             const StopToken& stop = {}) const;
  // Returns whether a level shows relief that the posts' level does not.
  bool has_relief(int level, int posts_level) const;

  // Returns a bound on the absolute height that finer levels add to a level's heights; the level is finer than the
  // posts.
  double left_out_m(int level, int posts_level) const;
  // Returns a bound on the absolute height of all detail over posts, after the mean over each post's cell has been
  // subtracted (DetailedTerrain).
  double max_detail_m(int posts_level) const;
  // Returns the 99th percentile of the absolute height of all octaves of diameters and wavelengths below `size_m`.
  // Octaves are independent, so their squares add up.
  double expected_left_out_m(double size_m) const;
  // Largest diameter or wavelength below an octave, m; 0: there are none.
  double left_out_size_m(int octave) const;
  // Means over a post's cell include the octaves that this many levels below the posts show (unit.detail measures the
  // remaining mean of smaller ones).
  static constexpr int kCellLevels = 5;
  // Returns the number of samples along a cell's side at which an octave is averaged: their spacing is at most 0.6 of
  // the octave's smallest diameter.
  static int samples_per_cell(int octave, int posts_level);
  // Octaves of diameters and of wavelengths, [2^k, 2^(k+1)) m, added to posts are below this one.
  static int past_largest_octave(int posts_level) { return smallest_octave(posts_level) - 1; }

  // Returns the share of relief, and of the means of craters, clods and fragments, at a direction. It fades to 0
  // towards the region's border, over the largest crater diameter or the longest wavelength.
  double share(const Vec3& direction) const { return preset_.region.share(direction, fade_m_); }
  // The larger of the largest crater diameter and the longest wavelength, m.
  double widest_m() const { return fade_m_; }
  // Returns whether the detail may change heights within `radius_m` of a direction.
  bool reaches(const Vec3& direction, double radius_m) const;

  // Mean height of an octave of craters, which is subtracted so that detail does not shift the ground as a whole.
  double mean_m(int octave) const;

  const CraterField& craters() const { return craters_; }
  const CraterBrightness& brightness() const { return brightness_; }
  const Relief& relief() const { return relief_; }
  const ClodField& clods() const { return clods_; }
  const FragmentField& fragments() const { return fragments_; }
  // Rocks are not part of the terrain: they lie on it (rocks_on_ground.h).
  const RockField& rocks() const { return rocks_; }

 private:
  int find_finest_level() const;
  std::vector<double> shares_of(const DirectionGrid& grid) const;  // share() per position; empty: 1 everywhere
  void add_relief(const DirectionGrid& grid, int octave, std::span<const double> weights, std::span<double> heights_m,
                  const StopToken& stop) const;
  void add_craters(const DirectionGrid& grid, int octave, std::span<const double> shares, std::span<double> heights_m,
                   std::span<float> in_crater, const StopToken& stop) const;

  DetailPreset preset_;
  CraterField craters_;
  CraterBrightness brightness_;
  Relief relief_;
  ClodField clods_;
  FragmentField fragments_;
  RockField rocks_;
  std::vector<double> means_m_;  // mean height of the craters, by octave, from the smallest octave
  // 99th percentile of the absolute difference from the mean height, by octave, from the smallest octave.
  std::vector<double> crater_p99_m_, relief_p99_m_, clod_p99_m_, fragment_p99_m_;
  double fade_m_;
  int finest_level_ = 0;
};

}  // namespace selenograph::dem
