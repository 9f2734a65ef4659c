#include "engine/lidar/echo.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace selenograph::engine {
namespace {

constexpr double kReach = 4;  // half-width of a sampled Gaussian in deviations: 3e-4 of its peak
constexpr std::size_t kMaxSamples = 4096;

}  // namespace

double pulse_deviation_m(double pulse_length_ns) {
  const double deviations_of_width = 2 * std::sqrt(2 * std::numbers::ln2);
  return kLight_m_ns / 2 * pulse_length_ns / deviations_of_width;
}

double part_deviation_m(double pulse_m, double range_m, double theta_rad, double cos_incidence) {
  constexpr double kGrazing = 0.02;  // cosine below which the ground is not a plane across a beam
  const double c = std::clamp(cos_incidence, kGrazing, 1.0), tan2 = (1 - c * c) / (c * c),
               theta2 = theta_rad * theta_rad;
  return std::sqrt(pulse_m * pulse_m + range_m * range_m * theta2 * (theta2 + tan2));
}

// Adds the return of these parts: their signals' sum, mean range and standard deviation, and the source of the largest.
void Echo::add(std::span<const EchoPart> parts) {
  double sum = 0, mean = 0, square = 0;
  const EchoPart* largest = &parts.front();
  const double near_m = parts.front().range_m;  // origin of the sums, so that squares lose no digits
  for (const EchoPart& p : parts) {
    const double r = p.range_m - near_m;
    sum += p.signal;
    mean += p.signal * r;
    square += p.signal * (r * r + p.deviation_m * p.deviation_m);
    if (p.signal > largest->signal) largest = &p;
  }
  if (!(sum > 0)) return;
  mean /= sum;
  returns_.push_back({near_m + mean, std::sqrt(std::max(0.0, square / sum - mean * mean)), sum, largest->source});
}

std::span<const EchoReturn> Echo::resolve_returns(std::span<EchoPart> parts) {
  returns_.clear();
  if (parts.empty()) return {};
  const auto [nearest, farthest] = std::minmax_element(
      parts.begin(), parts.end(), [](const EchoPart& a, const EchoPart& b) { return a.range_m < b.range_m; });
  double narrowest_m = std::numeric_limits<double>::infinity();
  for (const EchoPart& p : parts) narrowest_m = std::min(narrowest_m, p.deviation_m);
  // If all centres are within one deviation, every Gaussian is concave between them: there is only one maximum.
  if (farthest->range_m - nearest->range_m <= narrowest_m) {
    add(parts);
    return returns_;
  }
  std::sort(parts.begin(), parts.end(), [](const EchoPart& a, const EchoPart& b) { return a.range_m < b.range_m; });
  // Cut the echo into clusters at gaps that no Gaussian reaches.
  std::size_t first = 0;
  double reach_m = parts[0].range_m + kReach * parts[0].deviation_m;
  for (std::size_t i = 1; i <= parts.size(); ++i) {
    if (i == parts.size() || parts[i].range_m - kReach * parts[i].deviation_m > reach_m) {
      add_cluster(parts.subspan(first, i - first), narrowest_m);
      first = i;
    }
    if (i < parts.size()) reach_m = std::max(reach_m, parts[i].range_m + kReach * parts[i].deviation_m);
  }
  if (returns_.size() > kMaxReturns) {
    std::nth_element(returns_.begin(), returns_.begin() + kMaxReturns, returns_.end(),
                     [](const EchoReturn& a, const EchoReturn& b) { return a.signal > b.signal; });
    returns_.resize(kMaxReturns);
    std::sort(returns_.begin(), returns_.end(),
              [](const EchoReturn& a, const EchoReturn& b) { return a.range_m < b.range_m; });
  }
  return returns_;
}

// Samples the sum of overlapping Gaussians and cuts it at the dips.
void Echo::add_cluster(std::span<const EchoPart> parts, double narrowest_m) {
  const double from_m = parts.front().range_m, length_m = parts.back().range_m - from_m;
  if (length_m <= narrowest_m) return add(parts);
  // Sample between the first and the last centre: all maxima lie there.
  const std::size_t count = std::min(kMaxSamples, static_cast<std::size_t>(std::ceil(2 * length_m / narrowest_m)) + 1);
  const double step_m = length_m / static_cast<double>(count - 1);
  samples_.assign(count, 0);
  for (const EchoPart& p : parts) {
    const double reach = kReach * p.deviation_m, centre = p.range_m - from_m, peak = p.signal / p.deviation_m;
    const auto low = static_cast<std::size_t>(std::max(0.0, std::ceil((centre - reach) / step_m)));
    // Evaluate the Gaussian at equal steps by recurrence: the ratio of neighbours changes by a constant factor.
    const double s = step_m / p.deviation_m, z = (static_cast<double>(low) * step_m - centre) / p.deviation_m;
    double value = peak * std::exp(-z * z / 2), ratio = std::exp(-s * (z + s / 2));
    const double change = std::exp(-s * s);
    for (std::size_t k = low; k < count && static_cast<double>(k) * step_m <= centre + reach; ++k) {
      samples_[k] += value;
      value *= ratio;
      ratio *= change;
    }
  }
  // Walk from maximum to maximum. Cut at the lowest sample of a dip that is deep enough.
  std::size_t first = 0, lowest = 0;
  double peak = samples_[0], low = samples_[0];
  for (std::size_t k = 1; k < count; ++k) {
    if (samples_[k] < low) {
      low = samples_[k];
      lowest = k;
    }
    // The dip is low compared with the peak before it and with the rise after it.
    if (low < kDip * peak && low < kDip * samples_[k]) {
      const double cut_m = from_m + static_cast<double>(lowest) * step_m;
      std::size_t past_last = first;
      while (past_last < parts.size() && parts[past_last].range_m <= cut_m) ++past_last;
      if (past_last > first) add(parts.subspan(first, past_last - first));
      first = past_last;
      peak = low = samples_[k];
      lowest = k;
    } else if (samples_[k] > peak) {
      peak = low = samples_[k];
      lowest = k;
    }
  }
  if (first < parts.size()) add(parts.subspan(first));
}

}  // namespace selenograph::engine
