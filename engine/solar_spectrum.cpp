#include "engine/solar_spectrum.h"

#include <algorithm>

#include "engine/photometry.h"

namespace selenograph::engine {

double solar_irradiance_w_m2_um(double wavelength_um) {
  const auto table = std::span(kAstmE490);
  if (!(wavelength_um >= table.front().wavelength_um && wavelength_um <= table.back().wavelength_um)) return 0;
  const auto next = std::upper_bound(table.begin() + 1, table.end() - 1, wavelength_um,
                                     [](double w, const SpectralSample& s) { return w < s.wavelength_um; });
  const SpectralSample &a = *(next - 1), &b = *next;
  const double share = (wavelength_um - a.wavelength_um) / (b.wavelength_um - a.wavelength_um);
  return (a.irradiance_w_m2_um + share * (b.irradiance_w_m2_um - a.irradiance_w_m2_um)) *
         (kSolarConstant_w_m2 / kAstmE490Total_w_m2);
}

}  // namespace selenograph::engine
