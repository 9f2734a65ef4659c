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

// B(T) of eq. (3): spectral radiance of a blackbody, W m-2 sr-1 um-1. 0 at 0 K.
double planck_w_m2_sr_um(double wavelength_um, double temperature_k);

// Integral of weight(wavelength) B(T), W m-2 sr-1, to 1e-10 of itself for a weight that is a polynomial of low degree
// between the breakpoints, which rise.
double integrate_planck(const std::vector<double>& breakpoints_um, double temperature_k,
                        const std::function<double(double)>& weight);

// Integral of E_sun over the band at 1 au, W m-2: exact for the table, which is linear in between.
double solar_irradiance_w_m2(const Band& band);

// Integral of B(T) over the band, W m-2 sr-1.
double planck_w_m2_sr(const Band& band, double temperature_k);

// The band as a detector counts photons in it: its response times `efficiency` (linear between its points, 0 outside)
// times lambda / center. Electrons of eq. (8) are the radiance in this band at the center's photon energy, whatever the
// spectrum is. To 1e-5; no points of efficiency: 1. Throws ImpossibleRequest where nothing is left of the band.
Band in_photons(const Band& band, const std::vector<ResponsePoint>& efficiency);

// The wavelength whose photons the band's sunlight has as many of as if all were of it, efficiency included.
double sunlight_wavelength_um(const Band& band, const std::vector<ResponsePoint>& efficiency);

}  // namespace selenograph::engine
