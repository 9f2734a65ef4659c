// Brightness in the sky: V magnitudes and irradiance in a band.
#pragma once

#include <array>

#include "engine/frame/band.h"
#include "engine/sky/sky_observer.h"

namespace selenograph::engine {

// Returns the V magnitude of a planet, the Earth included: Mallama & Hilton, Astronomy and Computing 25, 10 (2018),
// equations 2 to 17. Saturn includes its rings. The terms for the rotation and season of Mars are neglected (0.1 mag);
// Neptune's magnitude is that since 2000. Phase angles are clamped to the range of the fits.
double planet_magnitude(Planet planet, const ApparentBody& body);
// Returns the V magnitude of the Sun at a distance.
double sun_magnitude(double distance_m);

// Returns the effective temperature of a star from its B - V, clamped to -0.4..2.5: Ballesteros, EPL 97, 34008 (2012).
double star_temperature_k(double b_v);

// Converts V magnitudes to irradiance, W m-2 at normal incidence. V = 0 is 3.63e-8 W m-2 um-1 at 0.55 um (Bessell,
// Castelli & Plez, A&A 333, 231, 1998, table A2). A star has a blackbody's spectrum, a planet that of sunlight.
class Starlight {
 public:
  // `band` null: all wavelengths.
  explicit Starlight(const Band* band);
  double of_star(double v_mag, double b_v) const;
  double of_planet(double v_mag) const;

 private:
  static constexpr double kBluest = -0.4, kReddest = 2.5, kStep = 0.02;
  std::array<double, 146> star_;  // irradiance of a star of V = 0, by B - V in steps of kStep
  double planet_;                 // irradiance of a planet of V = 0
};

}  // namespace selenograph::engine
