#include "engine/radiometry/solar_spectrum.h"

#include <charconv>
#include <vector>

#include "engine/radiometry/photometry.h"
#include "engine/support/interpolate.h"

namespace selenograph::engine {
namespace {

// The rows of astm_e490.csv after its head.
std::vector<SpectralSample> read_table(std::string_view text) {
  std::vector<SpectralSample> table;
  const char* const end = text.data() + text.size();
  for (const char* at = text.data() + text.find('\n') + 1; at < end; ++at) {
    SpectralSample sample{};
    at = std::from_chars(at, end, sample.wavelength_um).ptr + 1;
    at = std::from_chars(at, end, sample.irradiance_w_m2_um).ptr;
    table.push_back(sample);
  }
  return table;
}

}  // namespace

std::span<const SpectralSample> astm_e490() {
  static const std::vector<SpectralSample> table = read_table(astm_e490_csv());
  return table;
}

double solar_irradiance_w_m2_um(double wavelength_um) {
  const std::span<const SpectralSample> table = astm_e490();
  if (!(wavelength_um >= table.front().wavelength_um && wavelength_um <= table.back().wavelength_um)) return 0;
  const auto s = segment_at(table, wavelength_um, &SpectralSample::wavelength_um);
  return s.between(s.a.irradiance_w_m2_um, s.b.irradiance_w_m2_um) * (kSolarConstant_w_m2 / kAstmE490Total_w_m2);
}

}  // namespace selenograph::engine
