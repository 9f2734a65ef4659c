// Disc-equivalent reflectance A of the whole Moon, by published models of its irradiance.
//
// ROLO 311g: Kieffer & Stone (AJ 129, 2887, 2005), eq. (10) and table 4: 32 bands from 0.35 to 2.4 um, fitted from 1.55
// to 97 degrees of phase; its absolute scale is known to 5 to 10 %. LIME: Toledano et al. (ACP 24, 3649, 2024),
// coefficients of 2025-10-10: six bands from 0.44 to 1.64 um, up to 90 degrees, 2 % (k = 2).
#pragma once

#include <span>
#include <string_view>
#include <vector>

namespace selenograph::engine {

enum class DiscModel { rolo, lime };

// Phase angle, selenographic longitude of the Sun (from the mean Earth meridian; positive when waxing), latitude and
// longitude of the observer, degrees.
struct DiscGeometry {
  double phase_deg;
  double sun_lon_deg = 0, observer_lat_deg = 0, observer_lon_deg = 0;
};

// Returns the band centres, increasing.
std::span<const double> disc_bands_um(DiscModel model);

// Returns A of a band: the Moon's irradiance is A Omega / pi E_sun with its solid angle Omega. The equation is also
// evaluated outside the phase angles of its fit.
double disc_reflectance(DiscModel model, std::size_t band, const DiscGeometry& geometry);

// Returns A at a wavelength, linear between the centres of bands; NaN outside the first and the last.
double disc_reflectance_at(DiscModel model, double wavelength_um, const DiscGeometry& geometry);

// rolo.csv and lime.csv, made by deploy/support/embed.cmake.
std::string_view rolo_csv();
std::string_view lime_csv();

}  // namespace selenograph::engine
