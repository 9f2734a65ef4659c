#include "engine/radiometry/earth.h"

#include <algorithm>
#include <cmath>

namespace selenograph::engine {
namespace {

constexpr double kEarthRadius_m = 6378136.6;
constexpr double kBondAlbedo = 0.294;

// Returns the brightness relative to phase 0.
double magnitude_law(double phase_deg) {
  return std::pow(10, -0.4 * (earth_magnitude(phase_deg) - earth_magnitude(0)));
}

// Returns q = 2 integral of f(a) sin a, the Bond albedo over the geometric albedo.
double phase_integral() {
  static const double q = [] {
    constexpr int kSteps = 1800;
    double sum = 0;
    for (int i = 0; i < kSteps; ++i) {
      const double deg = (i + 0.5) * 180.0 / kSteps;
      sum += magnitude_law(deg) * std::sin(deg * kRadiansPerDegree);
    }
    return 2 * sum * kRadiansPerDegree * 180 / kSteps;
  }();
  return q;
}

}  // namespace

double earth_magnitude(double phase_deg) {
  const double a = std::min(phase_deg, 170.0);
  return -3.99 - 1.060e-3 * a + 2.054e-4 * a * a;
}

double earth_radius_deg(double distance_m) {
  return std::asin(std::min(kEarthRadius_m / distance_m, 1.0)) * kDegreesPerRadian;
}

double earth_phase_deg(const Earth& earth, const Sun& sun) {
  // The Sun's directions from Earth and Moon differ by at most 0.15 degrees.
  return std::acos(std::clamp(-earth.direction.dot(sun.direction), -1.0, 1.0)) * kDegreesPerRadian;
}

double earth_over_sun(const Earth& earth, const Sun& sun, const Band* band) {
  return earth_over_sun(earth.distance_m, earth_phase_deg(earth, sun), band);
}

double earth_over_sun(double distance_m, double phase_deg, const Band* band) {
  const double radius = kEarthRadius_m / distance_m;
  if (!band) return kBondAlbedo / phase_integral() * radius * radius * magnitude_law(phase_deg);
  const double au = kAstronomicalUnit_m / distance_m;
  return std::pow(10, -0.4 * (earth_magnitude(phase_deg) - kSun_mag)) * au * au;
}

}  // namespace selenograph::engine
