// The Sun's spectral irradiance outside of any atmosphere.
//
// ASTM E-490-00a, "Standard Solar Constant and Zero Air Mass Solar Spectral Irradiance Tables" (2000), as distributed
// by NREL (e490_00a_am0): 1697 wavelengths from 0.1195 to 1000 um, 1 nm apart up to 0.63 um, 2 nm to 2.5 um, 20 nm to 5
// um, coarser beyond; linear in between. The table's total is 1366.1 W m-2, the solar constant of its time: its shape
// is kept and its scale is set to kSolarConstant_w_m2.
#pragma once

#include <span>
#include <string_view>

namespace selenograph::engine {

struct SpectralSample {
  double wavelength_um;
  double irradiance_w_m2_um;
};

std::span<const SpectralSample> astm_e490();
std::string_view astm_e490_csv();  // astm_e490.csv, made by deploy/support/embed.cmake
// Integral of the table, linear between its wavelengths.
inline constexpr double kAstmE490Total_w_m2 = 1366.0908;

// Returns the spectral irradiance at 1 au, W m-2 um-1; 0 outside the table.
double solar_irradiance_w_m2_um(double wavelength_um);

}  // namespace selenograph::engine
