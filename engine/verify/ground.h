// Slopes and craters of a detail's ground, beside the laws that it was made for.
#pragma once

#include <vector>

#include "dem/detail/detail.h"

namespace selenograph::engine {

struct SlopeRow {
  double baseline_m;
  double rms_deg, median_deg;          // of slopes along the baseline, which are those of one direction
  double hurst;                        // of the RMS height difference, from the baseline before; NaN for the first
  double craters_share, relief_share;  // of the variance
  double published_deg;                // the preset's published median; NaN: it names none
};

struct CraterRow {
  double diameter_m;  // the smallest of an octave
  // Numbers per km^2: the law's (of craters that have formed by now), listed (from Detail::kWorn on), visible (from
  // kVisible on). Those that younger ones have taken away don't count.
  double law, listed, visible;
};

// Of the detail alone, on a sphere, with all of its octaves: also those that posts of kRootLevel, the coarsest that
// there are, leave to no detail (Detail::past_largest_octave; of the presets, wavelengths of 4096 m and more).
// `places`: squares of 40 x 40 baselines for each row. Octaves of less than an eighth of a baseline are left out.
std::vector<SlopeRow> ground_slopes(const dem::DetailPreset& preset, int places);
std::vector<CraterRow> ground_craters(const dem::DetailPreset& preset);

}  // namespace selenograph::engine
