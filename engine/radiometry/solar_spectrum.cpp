#include "engine/radiometry/solar_spectrum.h"

#include "engine/radiometry/photometry.h"
#include "engine/support/interpolate.h"

namespace selenograph::engine {

double solar_irradiance_w_m2_um(double wavelength_um) {
  const auto table = std::span(kAstmE490);
  if (!(wavelength_um >= table.front().wavelength_um && wavelength_um <= table.back().wavelength_um)) return 0;
  const auto s = segment_at(table, wavelength_um, &SpectralSample::wavelength_um);
  return s.between(s.a.irradiance_w_m2_um, s.b.irradiance_w_m2_um) * (kSolarConstant_w_m2 / kAstmE490Total_w_m2);
}

}  // namespace selenograph::engine
