// The Moon's own reflectance, in absolute units: the model `moon`.
//
// f_r = c(g) (2 L(g) / (mu0 + mu) + 1 - L(g)) with McEwen's L(g) (phase_law.h) and such a c(g) that a uniform sphere
// has the disc-equivalent reflectance A of the real Moon:
// - LIME's at its six wavelengths, linear between them (disc_models.h), from 2 to 90 degrees of phase;
// - below 0.44 and above 1.64 um ROLO's, as means of adjacent bands, scaled to LIME's at that wavelength; constant
//   beyond 0.3525 and 2.317 um;
// - below 2 and above 90 degrees in proportion to ROLO's (LIME's equation would rise by a third more than the 40 % that
//   Clementine saw from 4 to 0 degrees; Buratti et al., Icarus 124, 490, 1996), beyond 97 to Allen's, and from 150
//   degrees on with a constant f_r.
// Solar longitude and libration are left out: they are what an albedo map brings. Mare and highlands are the mean times
// the ratio of Sato's Hapke models (sato2014.h) at incidence and phase 30, emission 0 degrees.
#pragma once

#include "dem/base/stop_token.h"
#include "dem/value_maps/value_map.h"
#include "engine/frame/band.h"
#include "engine/frame/surface.h"
#include "engine/radiometry/phase_law.h"

namespace selenograph::engine {

// Returns the disc-equivalent reflectance of a uniform sphere.
double moon_reflectance(MoonGround ground, double wavelength_um, double phase_deg);

// Returns the constants of f_r, weighted by the sunlight in the band; null: all wavelengths.
TermsByPhase moon_terms(MoonGround ground, const Band* band);

// Returns the integral of E_sun A(30 degrees) over the band at 1 au, W m-2: the spectrum of moonlight.
double moonlight_w_m2(MoonGround ground, const Band& band);

// Uncertainty of the model `moon` in a band.
inline constexpr double kLimeUncertainty = 0.02, kRoloUncertainty = 0.1;
struct MoonTrust {
  double uncertainty;  // relative uncertainty of the disc's irradiance, k = 2: LIME's or ROLO's, from 2 to 90 degrees
  double extrapolated_share;  // share of the band's sunlight at wavelengths outside 0.35 to 2.5 um
};
MoonTrust moon_trust(const Band* band);
inline constexpr double kLimeFirst_deg = 2, kLimeLast_deg = 90;

// Largest ratio to the mean Moon that a map may request.
inline constexpr double kMoonMaxRatio = 5;

// Returns a map's mean over the near side, weighted by brightness at 45 degrees of phase, waxing and waning: the mean
// Moon's value in the map's units. Empty if the map leaves out more than 5 % of the near side. Computed once per map.
std::optional<double> near_side_mean(const dem::ValueMap& map, const StopToken& stop);

}  // namespace selenograph::engine
