#include "dem/detail/crater_ages.h"

#include <algorithm>
#include <cmath>

namespace selenograph::dem {
namespace {

constexpr double kLinear = 8.38e-4;  // craters of 1 km per km^2 and Ga

// Returns log10 of the cumulative number per km^2 on a surface of 1 Ga, above the diameter 10^log_km km.
double log_production(double log_km) {
  constexpr std::array<double, 12> kTerms{-3.0876,  -3.557528, 0.781027,  1.021521,  -0.156012, -0.444058,
                                          0.019977, 0.086850,  -0.005874, -0.006809, 8.25e-4,   5.54e-5};
  double sum = 0;
  for (std::size_t k = kTerms.size(); k-- > 0;) sum = sum * log_km + kTerms[k];
  return sum;
}

// Returns the cumulative number of craters of 1 km per km^2 on a surface of the given age.
double chronology(double age_Ga) { return 5.44e-14 * std::expm1(6.93 * age_Ga) + kLinear * age_Ga; }

}  // namespace

double production_per_m2(double diameter_m) {
  constexpr double kSmallest = -2, kLargest = 3, kSlopeStep = 1e-3;  // log10 of km
  const double log_km = std::log10(diameter_m / 1000), clamped = std::clamp(log_km, kSmallest, kLargest);
  double log_number = log_production(clamped);
  if (clamped != log_km) {
    // Continue with the slope at the end of the polynomial's range.
    const double inward = clamped == kSmallest ? kSlopeStep : -kSlopeStep;
    log_number += (log_km - clamped) * (log_production(clamped + inward) - log_number) / inward;
  }
  return std::pow(10, log_number) / 1e6;
}

double production_times(double age_Ma) { return chronology(age_Ma / 1000) / chronology(1); }

double age_Ma_of(double production_times) {
  const double number = production_times * chronology(1);
  // Newton's method converges monotonically from above, because the number is convex in the age.
  double age_Ga = std::min(number / kLinear, 5.0);
  for (int i = 0; i < 60; ++i) {
    const double slope = 6.93 * 5.44e-14 * std::exp(6.93 * age_Ga) + kLinear;
    const double step = (chronology(age_Ga) - number) / slope;
    age_Ga -= step;
    if (!(step > 1e-12 * age_Ga)) break;
  }
  return 1000 * age_Ga;
}

// Tabulates, by diameter, how often the production of 1 Ga yields as many craters as the law counts as visible.
CraterAges::CraterAges(const SizeFrequency& visible, double smallest_m, double largest_m, double surface_age_Ma)
    : visible_(visible),
      first_(std::log(smallest_m)),
      step_(std::max(1e-9, std::log(largest_m / smallest_m) / static_cast<double>(log_times_.size() - 1))),
      formed_(production_times(surface_age_Ma)) {
  constexpr double kWide = 1.05;  // factor to both ends of the interval of diameters that stands for one diameter
  for (std::size_t i = 0; i < log_times_.size(); ++i) {
    const double diameter_m = std::exp(first_ + static_cast<double>(i) * step_);
    const double low = diameter_m / kWide, high = diameter_m * kWide;
    // A crater lasts until as many have formed as are visible.
    log_times_[i] = std::log(visible.between(low, high) / (production_per_m2(low) - production_per_m2(high)));
  }
}

CraterAges::Life CraterAges::life(double diameter_m) const {
  const double last = static_cast<double>(log_times_.size() - 1);
  const double index = std::clamp((std::log(diameter_m) - first_) / step_, 0.0, last);
  const auto i = std::min(static_cast<std::size_t>(index), log_times_.size() - 2);
  const double f = index - static_cast<double>(i);
  const double worn_out = std::exp(log_times_[i] + f * (log_times_[i + 1] - log_times_[i]));
  return {std::min(1.0, formed_ / worn_out), worn_out, std::min(worn_out, formed_)};
}

double CraterAges::number_per_m2(double smallest_m, double largest_m) const {
  constexpr int kIntervals = 64;  // equal ratios of diameters, in each of which the share is taken as constant
  double sum = 0;
  for (int i = 0; i < kIntervals; ++i) {
    const auto diameter_at = [&](double interval) {
      return smallest_m * std::pow(largest_m / smallest_m, interval / kIntervals);
    };
    sum += visible_.between(diameter_at(i), diameter_at(i + 1)) * life(diameter_at(i + 0.5)).share;
  }
  return sum;
}

}  // namespace selenograph::dem
