// The echo of a beam: what its sub-rays return, spread over the pulse, and the returns that can be told apart in it.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "engine/radiometry/spectrum.h"

namespace selenograph::engine {

// Contribution of one sub-ray: a Gaussian in range.
struct EchoPart {
  double range_m;  // of its middle
  double deviation_m;
  double signal;
  std::uint32_t of = 0;  // what it comes from; for the caller
};

// A part of the echo between two dips.
struct EchoReturn {
  double range_m, width_m, signal;  // centroid, standard deviation, sum
  std::uint32_t of;                 // of its largest part
};

inline constexpr double kLight_m_ns = kSpeedOfLight_m_s / 1e9;

// As ranges: half of the way light travels. The standard deviation of a Gaussian pulse of a full width at half maximum.
double pulse_deviation_m(double pulse_length_ns);

// Deviation of a part's echo: the pulse, and the range across the part of a beam that it stands for, on the plane that
// it meets. Gardner (IEEE TGRS 30, 1061, 1992), eq. (14) with its terms for the pulse, the curved wavefront and the
// slope: sigma^2 = sigma_p^2 + R^2 theta^2 (theta^2 + tan^2 i), where theta is the deviation of the beam along one
// direction and i the angle of incidence.
double part_deviation_m(double pulse_m, double range_m, double theta_rad, double cos_incidence);

// The returns, nearest first. The sum of the parts' Gaussians is sampled at half of the narrowest one's deviation;
// neighbouring maxima are two returns where the dip between them is below kDip of the lower one. `parts` is sorted by
// range. At most kMost: the weakest are left out.
inline constexpr double kDip = 0.8;
class Echo {
 public:
  static constexpr std::size_t kMost = 16;
  std::span<const EchoReturn> returns_of(std::span<EchoPart> parts);

 private:
  void add_cluster(std::span<const EchoPart> parts, double narrowest_m);
  void add(std::span<const EchoPart> parts);
  std::vector<EchoReturn> returns_;
  std::vector<double> samples_;  // kept from call to call
};

}  // namespace selenograph::engine
