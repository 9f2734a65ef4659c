// The Earth as a source of light at the Moon.
#pragma once

#include "engine/frame/band.h"
#include "engine/frame/indirect.h"
#include "engine/frame/sun.h"

namespace selenograph::engine {

// Returns the angular radius of the Earth's disc; equatorial radius 6378.1366 km (IAU WGCCRE 2015).
double earth_radius_deg(double distance_m);

// Returns the phase angle at the Earth, between Sun and Moon, degrees: 0 at full Earth.
double earth_phase_deg(const Earth& earth, const Sun& sun);

// Returns the V magnitude at 1 au from Sun and observer: Mallama & Hilton, Astronomy and Computing 25, 10 (2018),
// equation 5, up to 170 degrees and constant beyond.
double earth_magnitude(double phase_deg);

// V magnitude of the Sun at 1 au: Willmer, ApJS 236, 47 (2018).
inline constexpr double kSun_mag = -26.76;

// Both return the Earth's irradiance at the Moon at normal incidence, over the Sun's there, in a band or over all
// wavelengths (null).
//
// Phase law and brightness in the visible are those of earth_magnitude and kSun_mag; all bands have the visible's
// albedo. Over all wavelengths the same phase law is scaled to a Bond albedo of 0.294 (Stephens et al., Rev. Geophys.
// 53, 141, 2015): 0.084 W m-2 at full Earth. Clouds change it by 30 % from day to day. The infrared that the Earth
// emits, as much again at the Moon, is left out (Glenar et al., Icarus 321, 841, 2019).
double earth_over_sun(const Earth& earth, const Sun& sun, const Band* band);
double earth_over_sun(double distance_m, double phase_deg, const Band* band);

}  // namespace selenograph::engine
