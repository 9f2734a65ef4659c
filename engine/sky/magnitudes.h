// Brightness in the sky: V magnitudes and irradiance in a band.
#pragma once

#include <array>

#include "engine/frame/band.h"
#include "engine/sky/sky_observer.h"

namespace selenograph::engine {

// V magnitude of a planet, the Earth included: Mallama & Hilton, Astronomy and Computing 25, 10 (2018), equations 2 to
// 17. Saturn with its rings. Left out are what depends on rotation and season of Mars (0.1 mag); Neptune is that of
// 2000 and later. Beyond the phase angles of the fits: that of the nearest one.
double planet_magnitude(Planet planet, const ApparentBody& body);
// V of the Sun at a distance.
double sun_magnitude(double distance_m);

// Effective temperature of a star by its B - V: Ballesteros, EPL 97, 34008 (2012); -0.4 to 2.5, beyond the nearest.
double star_temperature_k(double b_v);

// Irradiance, W m-2 at normal incidence, by V magnitude. V = 0 is 3.63e-8 W m-2 um-1 at 0.55 um (Bessell, Castelli &
// Plez, A&A 333, 231, 1998, table A2). A star has the spectrum of a blackbody, a planet that of sunlight.
class Starlight {
 public:
  // `band` null: all wavelengths.
  explicit Starlight(const Band* band);
  double of_star(double v_mag, double b_v) const;
  double of_planet(double v_mag) const;

 private:
  static constexpr double kBluest = -0.4, kReddest = 2.5, kStep = 0.02;
  std::array<double, 146> star_;  // of V = 0, by B - V in steps
  double planet_;                 // of V = 0
};

}  // namespace selenograph::engine
