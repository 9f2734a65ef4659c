// Effects of an atmosphere on radiance, computed elsewhere (SENSOR++ section 2.2: MODTRAN), as a table over wavelength.
#pragma once

#include <string>
#include <vector>

#include "engine/radiometry/spectrum.h"

namespace selenograph::engine {

struct AtmosphereRow {
  double wavelength_um;
  double transmittance;            // tau, surface to sensor, 0 to 1
  double irradiance_w_m2_um;       // E_sun at the surface, normal to the sunlight
  double indirect_w_m2_sr_um;      // L_ind
  double scattered_w_m2_sr_um;     // L_sc
  double thermal_path_w_m2_sr_um;  // L_th
};

// Table of an atmosphere's effects at 1 au, valid for the viewing geometry and surface that it was computed for.
class Atmosphere {
 public:
  // Reads a CSV file whose first line that is not a comment (#) is
  //   wavelength_um,transmittance,e_sun_w_m2_um,l_ind_w_m2_sr_um,l_sc_w_m2_sr_um,l_th_w_m2_sr_um
  // followed by at least two rows at increasing wavelengths. Throws DataError naming file and line.
  static Atmosphere read(const std::string& path);

  explicit Atmosphere(std::vector<AtmosphereRow> rows) : rows_(std::move(rows)) {}
  const std::vector<AtmosphereRow>& rows() const { return rows_; }

  // Integrals over a band, exact for a table that is linear between its rows.
  struct InBand {
    double direct_w_m2;  // E_sun tau
    double indirect_w_m2_sr, scattered_w_m2_sr, thermal_path_w_m2_sr;
    double emitted_w_m2_sr;  // B(T) tau
  };
  // Integrates over a band. Throws ImpossibleRequest if the band is not within the table.
  InBand over(const Band& band, double temperature_k) const;

 private:
  std::vector<AtmosphereRow> rows_;
};

}  // namespace selenograph::engine
