#include "engine/radiometry/atmosphere.h"

#include <fmt/format.h>

#include <string_view>

#include "dem/base/error.h"
#include "engine/support/csv.h"
#include "engine/support/interpolate.h"

namespace selenograph::engine {
namespace {

constexpr std::string_view kHeader =
    "wavelength_um,transmittance,e_sun_w_m2_um,l_ind_w_m2_sr_um,l_sc_w_m2_sr_um,l_th_w_m2_sr_um";

AtmosphereRow row_at(const std::vector<AtmosphereRow>& rows, double wavelength_um) {
  const auto s = segment_at(rows, wavelength_um, &AtmosphereRow::wavelength_um);
  return {wavelength_um,
          s.between(s.a.transmittance, s.b.transmittance),
          s.between(s.a.irradiance_w_m2_um, s.b.irradiance_w_m2_um),
          s.between(s.a.indirect_w_m2_sr_um, s.b.indirect_w_m2_sr_um),
          s.between(s.a.scattered_w_m2_sr_um, s.b.scattered_w_m2_sr_um),
          s.between(s.a.thermal_path_w_m2_sr_um, s.b.thermal_path_w_m2_sr_um)};
}

AtmosphereRow parse_row(std::string_view line) {
  const std::vector<double> numbers = csv_numbers(line);
  if (numbers.size() != 6) throw BadLine("six numbers separated by commas are expected");
  for (const double number : numbers)
    if (!(number >= 0 && number < 1e12)) throw BadLine("a number is negative or too large");
  if (numbers[1] > 1) throw BadLine("transmittance is above 1");
  return {numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], numbers[5]};
}

}  // namespace

Atmosphere Atmosphere::read(const std::string& path) {
  std::vector<AtmosphereRow> rows;
  bool header = false;
  each_csv_line(path, [&](std::string_view line) {
    if (!header) {
      if (line != kHeader) throw BadLine(fmt::format("the header must be {}", kHeader));
      header = true;
      return;
    }
    rows.push_back(parse_row(line));
    if (rows.size() > 1 && !(rows.back().wavelength_um > rows[rows.size() - 2].wavelength_um))
      throw BadLine("wavelengths must rise");
  });
  if (rows.size() < 2) throw DataError(path, "has fewer than two rows");
  return Atmosphere(std::move(rows));
}

Atmosphere::InBand Atmosphere::over(const Band& band, double temperature_k) const {
  const double first = band.response().front().wavelength_um, last = band.response().back().wavelength_um;
  constexpr double kRounding = 1e-12;  // rounding of a band's ends, which follow from its center and width
  if (first < rows_.front().wavelength_um * (1 - kRounding) || last > rows_.back().wavelength_um * (1 + kRounding))
    throw ImpossibleRequest(fmt::format("the band, {} to {} um, is not within the atmosphere's table, {} to {} um",
                                        first, last, rows_.front().wavelength_um, rows_.back().wavelength_um));
  const auto at = [this](double w) { return row_at(rows_, w); };
  std::vector<double> table;
  for (const AtmosphereRow& r : rows_) table.push_back(r.wavelength_um);
  const std::vector<double> points = band.breakpoints(table);
  InBand sum{};
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    // Simpson's rule: exact for products of three linear functions.
    const double from = points[i], to = points[i + 1], middle = (from + to) / 2;
    for (const auto& [w, weight] : {std::pair{from, 1.0}, {middle, 4.0}, {to, 1.0}}) {
      const AtmosphereRow row = at(w);
      const double share = weight * (to - from) / 6 * band.response_at(w);
      sum.direct_w_m2 += share * row.irradiance_w_m2_um * row.transmittance;
      sum.indirect_w_m2_sr += share * row.indirect_w_m2_sr_um;
      sum.scattered_w_m2_sr += share * row.scattered_w_m2_sr_um;
      sum.thermal_path_w_m2_sr += share * row.thermal_path_w_m2_sr_um;
    }
  }
  sum.emitted_w_m2_sr =
      integrate_planck(points, temperature_k, [&](double w) { return band.response_at(w) * at(w).transmittance; });
  return sum;
}

}  // namespace selenograph::engine
