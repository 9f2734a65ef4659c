// The echo of a beam, and the returns resolved in it.
//
//   signal |    _            Each hit of a sub-ray adds a Gaussian in range (EchoPart). Their sum is cut into returns
//   at
//          |   / \  _  _     a dip below kDip of the lower of the two maxima beside it: here 2 returns, because the
//          second
//          |__/   \/ \/ \__  dip is too shallow.
//          +--------------- range
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "engine/radiometry/spectrum.h"

namespace selenograph::engine {

// Contribution of one sub-ray: a Gaussian in range.
struct EchoPart {
  double range_m;  // of its centre
  double deviation_m;
  double signal;
  std::uint32_t source = 0;  // identifies the surface; chosen by the caller
};

// The echo between two dips.
struct EchoReturn {
  double range_m, width_m, signal;  // centroid, standard deviation, sum
  std::uint32_t source;             // EchoPart::source of the strongest part
};

inline constexpr double kLight_m_ns = kSpeedOfLight_m_s / 1e9;

// Returns the standard deviation, in range (half the distance that light travels), of a Gaussian pulse whose full width
// at half maximum is given.
double pulse_deviation_m(double pulse_length_ns);

// Returns the standard deviation of a sub-ray's echo from the plane that it hits: the pulse's, and that of the range
// across the sub-ray's footprint. Gardner (IEEE TGRS 30, 1061, 1992), eq. (14) with its terms for the pulse, the curved
// wavefront and the slope: sigma^2 = sigma_p^2 + R^2 theta^2 (theta^2 + tan^2 i), where theta is the sub-ray's
// deviation along one direction and i the angle of incidence.
double part_deviation_m(double pulse_m, double range_m, double theta_rad, double cos_incidence);

// Resolves the returns of an echo. The sum of the Gaussians is sampled at half the smallest deviation. Two neighbouring
// maxima are two returns if the dip between them is below kDip of the lower one.
inline constexpr double kDip = 0.8;
class Echo {
 public:
  static constexpr std::size_t kMaxReturns = 16;
  // Returns the returns, nearest first; of more than kMaxReturns, the weakest are left out. Sorts `parts` by range. The
  // span is valid until the next call.
  std::span<const EchoReturn> resolve_returns(std::span<EchoPart> parts);

 private:
  void add_cluster(std::span<const EchoPart> parts, double narrowest_m);
  void add(std::span<const EchoPart> parts);
  std::vector<EchoReturn> returns_;
  std::vector<double> samples_;  // a member so that its memory is reused
};

}  // namespace selenograph::engine
