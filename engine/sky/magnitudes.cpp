#include "engine/sky/magnitudes.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/frame/sun.h"
#include "engine/radiometry/earth.h"
#include "engine/radiometry/photometry.h"
#include "engine/radiometry/solar_spectrum.h"
#include "engine/radiometry/spectrum.h"

namespace selenograph::engine {
namespace {

constexpr double kZeroPoint_w_m2_um = 3.63e-8, kVisual_um = 0.55;  // spectral irradiance of V = 0; its wavelength

// Returns the sum of coefficients[k] x^k.
template <std::size_t N>
double polynomial(const double (&coefficients)[N], double x) {
  double sum = 0;
  for (std::size_t i = N; i-- > 0;) sum = sum * x + coefficients[i];
  return sum;
}

// Functions named after planets return the magnitude at 1 au from both the Sun and the observer, by Mallama & Hilton
// (2018); a: phase angle in degrees. Phase angles beyond the paper's range count as its end.
double mercury(double a) {
  return polynomial({-0.613, 6.3280e-2, -1.6336e-3, 3.3644e-5, -3.4265e-7, 1.6893e-9, -3.0334e-12}, std::min(a, 170.0));
}

double venus(double a) {
  return a <= 163.7 ? polynomial({-4.384, -1.044e-3, 3.687e-4, -2.814e-6, 8.938e-9}, a)
                    : polynomial({236.05828, -2.81914, 8.39034e-3}, std::min(a, 179.0));
}

double mars(double a) {
  return a <= 50 ? polynomial({-1.601, 0.02267, -0.0001302}, a)
                 : polynomial({-0.367, -0.02573, 0.0003445}, std::min(a, 120.0));
}

double jupiter(double a) {
  if (a <= 12) return polynomial({-9.395, -3.7e-4, 6.16e-4}, a);
  return -9.428 - 2.5 * std::log10(polynomial({1.0, -1.507, -0.363, -0.062, 2.809, -1.876}, std::min(a, 130.0) / 180));
}

// Returns the direction of a planet's north pole, ICRF, by WGCCRE 2015 without its motion.
Vec3 pole(double ra_deg, double dec_deg) {
  const double ra = ra_deg * kRadiansPerDegree, dec = dec_deg * kRadiansPerDegree;
  return {std::cos(dec) * std::cos(ra), std::cos(dec) * std::sin(ra), std::sin(dec)};
}

// Sines of the planetocentric latitudes of the subsolar and the sub-observer point.
struct SubLatitudes {
  double sun, observer;
  SubLatitudes(const Vec3& north, const ApparentBody& body)
      : sun(-north.dot(body.from_sun)), observer(-north.dot(body.from_observer)) {}
};

// Within 6.5 degrees, which the Earth sees, the law includes the rings; beyond, it is that of the globe. The rings
// shine only if the Sun and the observer are on the same side of their plane.
double saturn(double a, const ApparentBody& body) {
  if (a > 6.5) return polynomial({-8.94, 2.446e-4, 2.672e-4, -1.505e-6, 4.767e-9}, std::min(a, 150.0));
  static const Vec3 kNorth = pole(40.589, 83.537);
  const SubLatitudes sub(kNorth, body);
  // Geometric mean of the two latitudes: the angle at which the rings are open, rad.
  const double tilt = sub.sun * sub.observer > 0 ? std::sqrt(std::asin(sub.sun) * std::asin(sub.observer)) : 0;
  return -8.914 - 1.825 * std::sin(tilt) + 0.026 * a - 0.378 * std::sin(tilt) * std::exp(-2.25 * a);
}

double uranus(double a, const ApparentBody& body) {
  static const Vec3 kNorth = pole(257.311, -15.175);
  const SubLatitudes sub(kNorth, body);
  // Convert to planetographic latitudes; the flattening is 0.0229.
  const auto latitude_deg = [](double sine) {
    const double centric = std::asin(std::clamp(sine, -1.0, 1.0));
    return std::abs(std::atan(std::tan(centric) / ((1 - 0.0229) * (1 - 0.0229)))) * kDegreesPerRadian;
  };
  // Below 3.1 degrees, the phase angles seen from the Earth, the paper has no phase term.
  const double mean_deg = (latitude_deg(sub.sun) + latitude_deg(sub.observer)) / 2;
  return -7.110 - 8.4e-4 * mean_deg + (a > 3.1 ? polynomial({0, 6.587e-3, 1.045e-4}, std::min(a, 154.0)) : 0);
}

// Returns the magnitude at 1 au from both the Sun and the observer.
double at_one_au(Planet planet, const ApparentBody& body) {
  const double a = body.phase_deg;
  switch (planet) {
    case Planet::mercury:
      return mercury(a);
    case Planet::venus:
      return venus(a);
    case Planet::earth:
      return earth_magnitude(a);
    case Planet::mars:
      return mars(a);
    case Planet::jupiter:
      return jupiter(a);
    case Planet::saturn:
      return saturn(a, body);
    case Planet::uranus:
      return uranus(a, body);
    case Planet::neptune:
      // Below 1.9 degrees, the phase angles seen from the Earth, the paper has no phase term.
      return -7.00 + (a > 1.9 ? polynomial({0, 7.944e-3, 9.617e-5}, std::min(a, 133.0)) : 0);
  }
  return 0;
}

// Returns the irradiance in a band of a blackbody of V = 0: its integral over the band, scaled so that its spectral
// irradiance at 0.55 um is the zero point's. `band` null: all wavelengths.
double star_of_v0(double temperature_k, const Band* band) {
  // The Stefan-Boltzmann constant over pi: radiance per T^4.
  constexpr double kAll_w_m2_sr_k4 = 5.670374419e-8 / std::numbers::pi;
  const double integral = band ? planck_w_m2_sr(*band, temperature_k) : kAll_w_m2_sr_k4 * std::pow(temperature_k, 4);
  return kZeroPoint_w_m2_um / planck_w_m2_sr_um(kVisual_um, temperature_k) * integral;
}

}  // namespace

double planet_magnitude(Planet planet, const ApparentBody& body) {
  return 5 * std::log10(body.distance_m / kAstronomicalUnit_m * (body.sun_distance_m / kAstronomicalUnit_m)) +
         at_one_au(planet, body);
}

double sun_magnitude(double distance_m) { return kSun_mag + 5 * std::log10(distance_m / kAstronomicalUnit_m); }

double star_temperature_k(double b_v) {
  const double x = 0.92 * std::clamp(b_v, -0.4, 2.5);
  return 4600 * (1 / (x + 1.7) + 1 / (x + 0.62));
}

Starlight::Starlight(const Band* band) {
  for (std::size_t i = 0; i < star_.size(); ++i)
    star_[i] = star_of_v0(star_temperature_k(kBluest + kStep * static_cast<double>(i)), band);
  planet_ = kZeroPoint_w_m2_um / solar_irradiance_w_m2_um(kVisual_um) *
            (band ? solar_irradiance_w_m2(*band) : kSolarConstant_w_m2);
}

double Starlight::of_star(double v_mag, double b_v) const {
  const double position = (std::clamp(b_v, kBluest, kReddest) - kBluest) / kStep;  // in the table of B - V
  const auto i = std::min(static_cast<std::size_t>(position), star_.size() - 2);
  const double share = position - static_cast<double>(i);
  return std::pow(10, -0.4 * v_mag) * ((1 - share) * star_[i] + share * star_[i + 1]);
}

double Starlight::of_planet(double v_mag) const { return std::pow(10, -0.4 * v_mag) * planet_; }

}  // namespace selenograph::engine
