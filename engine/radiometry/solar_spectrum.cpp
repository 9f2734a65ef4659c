#include "engine/radiometry/solar_spectrum.h"

#include <vector>

#include "engine/radiometry/photometry.h"
#include "engine/support/csv.h"
#include "engine/support/interpolate.h"

namespace selenograph::engine {
namespace {

std::vector<SpectralSample> read_table() {
  std::vector<SpectralSample> table;
  for (const std::vector<double>& row : csv_rows(astm_e490_csv())) table.push_back({row.at(0), row.at(1)});
  return table;
}

}  // namespace

std::span<const SpectralSample> astm_e490() {
  static const std::vector<SpectralSample> table = read_table();
  return table;
}

double solar_irradiance_w_m2_um(double wavelength_um) {
  const std::span<const SpectralSample> table = astm_e490();
  if (!(wavelength_um >= table.front().wavelength_um && wavelength_um <= table.back().wavelength_um)) return 0;
  const auto s = segment_at(table, wavelength_um, &SpectralSample::wavelength_um);
  return s.between(s.a.irradiance_w_m2_um, s.b.irradiance_w_m2_um) * (kSolarConstant_w_m2 / kAstmE490Total_w_m2);
}

}  // namespace selenograph::engine
