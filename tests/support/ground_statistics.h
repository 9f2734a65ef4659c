// Slopes, craters, rocks and albedo of a detail's ground, to be compared with the laws that it was made from.
#pragma once

#include <span>
#include <vector>

#include "dem/detail/detail.h"

namespace selenograph::test {

struct SlopeRow {
  double baseline_m;
  double rms_deg, median_deg;  // of slopes along the baseline, in one direction
  double hurst;                // exponent of the RMS height difference since the previous row; NaN: first row
  double craters_share, relief_share, clods_share, fragments_share;  // shares of the variance of height differences
  double steepest_deg;                                               // 99th percentile of the slopes
  double published_deg;                                              // the preset's published median; NaN below 0.5 m
};

struct CraterRow {
  double diameter_m;  // smallest diameter of an octave
  // Numbers per km^2: by the law (all craters formed so far), listed (at least Detail::kWorn deep), visible (at least
  // kVisible deep). Listed and visible craters exclude those erased by younger ones.
  double law, listed, visible;
  double depth_over_diameter;  // mean of the visible ones; NaN: there are none
};

// Rocks between craters of an octave of diameters, fragments included.
struct RockRow {
  double diameter_m;  // smallest diameter of the octave
  double law, area;   // area of circles of their diameters over the ground's: by the law, of those that are drawn
  double fragments;   // the part of `area` that is fragments
};

// RMS heights of windows of the ground, about their mean plane.
struct RoughnessRow {
  double window_m;
  double median_m, low_m, high_m;  // low, high: 5th and 95th percentile of the windows
  double median_about_mean_m;      // with the slope of the window
};

// The factor of the albedo (dem/detail/crater_brightness.h) seen in pixels of one size.
struct AlbedoRow {
  double pixel_m;
  double mean, deviation;
  double bright_share;  // of the ground, 30 % and more brighter than its median
};

// All measure the detail alone, on a sphere, with all of its octaves. This includes octaves so large that even the
// coarsest posts (kRootLevel) show them, which detail on terrain never adds (Detail::past_largest_octave; in the
// presets, wavelengths of 4096 m and more). `places`: squares of 40 x 40 baselines for each row. Octaves below an
// eighth of a baseline are left out.

// Baselines rise. Throws std::bad_optional_access for a preset that names no published slopes.
std::vector<SlopeRow> ground_slopes(const dem::DetailPreset& preset, std::span<const double> baselines_m, int places);
std::vector<CraterRow> ground_craters(const dem::DetailPreset& preset);
// Empty for a preset without rocks.
std::vector<RockRow> ground_rocks(const dem::DetailPreset& preset);
// In windows of 125 mm, one at each place.
RoughnessRow ground_roughness(const dem::DetailPreset& preset, int places);
// In pixels of 0.25, 1 and 10 m, in squares of 160 x 160 pixels.
std::vector<AlbedoRow> ground_albedo(const dem::DetailPreset& preset, int places);

}  // namespace selenograph::test
