// Statistics of a round trip's differences: their size and bias.
#pragma once

#include <array>
#include <string_view>
#include <vector>

#include "engine/verify/round_trip.h"

namespace selenograph::engine {

// Statistics of a group of differences. NaN where there are too few.
//
// Neighbouring differences are not independent, so the standard error comes from the scatter of the means over squares
// of 32 x 32 posts (more in windows above 1024), each weighted by its posts, and is no smaller than double's rounding
// of a radius (0.07 nm). z = mean / standard error: without a bias |z| is above 3 in one group of 370.
//
// In mode camera the plane between pixels lies above a post in a hollow and below one on a rise: groups of posts with a
// common shape of the ground (a slope class, or a quadrant within one crater) are biased by that.
struct GroupStatistics {
  std::size_t posts = 0;
  double mean_m = 0, mean_absolute_m = 0, rms_m = 0;
  double standard_error_m = 0, z = 0;
};

struct Quadrant {
  std::string_view name;  // quadrant of the window: "NE", "NW", "SE", "SW"
  GroupStatistics statistics;
};

// Posts whose slope is at least from_deg and below to_deg. Slopes are the tile's own, from the neighbours on both
// sides.
struct SlopeClass {
  double from_deg, to_deg;
  GroupStatistics statistics;
};

struct Percentile {
  double percent, value_m;
};

// Counts in bins of equal width over [-reach_m, reach_m]. The number of bins is odd, so that zero is in the middle of
// one.
struct Histogram {
  double reach_m =
      0;  // the 99.5th percentile of the absolute differences, rounded up to 1, 2, 3 or 5 times a power of ten
  std::array<std::size_t, 61> counts{};
  std::size_t below = 0, above = 0;
};

struct DifferenceStatistics {
  GroupStatistics all;
  double median_m = 0, median_absolute_m = 0, standard_deviation_m = 0;
  double worst_m = 0;  // signed, largest in size
  int worst_row = -1, worst_col = -1;
  std::vector<Percentile> percentiles, absolute_percentiles;
  Histogram histogram;
  std::array<Quadrant, 4> quadrants;
  std::vector<SlopeClass> slopes;
};

// Returns the statistics. Percentiles interpolate between order statistics (Hyndman & Fan 1996, type 7; NumPy's
// default).
DifferenceStatistics statistics_of(const RoundTrip& trip);

}  // namespace selenograph::engine
