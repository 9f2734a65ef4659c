// Integrals over spectral bands: SENSOR++ (Paproth et al.), section 2.2, the spectral quantities in
// equations (2) and (3). Wavelengths in micrometres, spectral quantities per micrometre.
#pragma once

#include <functional>
#include <vector>

#include "engine/frame/band.h"

namespace selenograph::engine {

// CODATA 2018; exact since the SI of 2019.
inline constexpr double kPlanck_j_s = 6.62607015e-34;
inline constexpr double kSpeedOfLight_m_s = 299792458.0;
inline constexpr double kBoltzmann_j_k = 1.380649e-23;

// Returns B(T) of eq. (3): spectral radiance of a blackbody, W m-2 sr-1 um-1. 0 at 0 K.
double planck_w_m2_sr_um(double wavelength_um, double temperature_k);

// Returns the integral of weight(wavelength) B(T), W m-2 sr-1, with a relative error of 1e-10 for a weight that is a
// polynomial of low degree between the breakpoints, which increase.
double integrate_planck(const std::vector<double>& breakpoints_um, double temperature_k,
                        const std::function<double(double)>& weight);

// Returns the integral of E_sun over the band at 1 au, W m-2; exact for the table, which is linear in between.
double solar_irradiance_w_m2(const Band& band);

// Returns the integral of B(T) over the band, W m-2 sr-1.
double planck_w_m2_sr(const Band& band, double temperature_k);

// Returns the band in which a detector counts photons: the response times `efficiency` (linear between its points, 0
// outside; no points: 1) times lambda / center. Electrons of eq. (8) are the radiance in this band at the center's
// photon energy, for any spectrum. Accurate to 1e-5. Throws ImpossibleRequest if the resulting response is 0
// everywhere.
Band in_photons(const Band& band, const std::vector<ResponsePoint>& efficiency);

// Returns the wavelength at which a band's light, were it monochromatic, would have the same number of photons,
// efficiency included. `light_w_m2`: returns the light in a band, e.g. solar_irradiance_w_m2.
double photon_wavelength_um(const Band& band, const std::vector<ResponsePoint>& efficiency,
                            const std::function<double(const Band&)>& light_w_m2);

}  // namespace selenograph::engine
