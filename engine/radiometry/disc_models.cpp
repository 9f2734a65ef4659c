#include "engine/radiometry/disc_models.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "dem/grid/geodesy.h"
#include "engine/support/csv.h"

namespace selenograph::engine {
namespace {

// Coefficients of one band in Kieffer & Stone's eq. (10).
struct Coefficients {
  std::array<double, 4> a;  // powers of the phase angle in radians
  std::array<double, 3> b;  // odd powers of the Sun's longitude in radians
  std::array<double, 4> c;  // libration: the observer's latitude and longitude in degrees
  std::array<double, 3> d;
  std::array<double, 4> p;  // scales of the residual terms, in degrees of phase angle
};

struct Table {
  std::vector<double> centre_um;
  std::vector<Coefficients> bands;
};

// ROLO's c and p are the same for all bands.
Table read_rolo() {
  Table table;
  for (const std::vector<double>& r : csv_rows(rolo_csv())) {
    table.centre_um.push_back(r.at(0));
    table.bands.push_back({{r[1], r[2], r[3], r[4]},
                           {r[5], r[6], r[7]},
                           {0.00034115, -0.0013425, 0.00095906, 0.00066229},
                           {r[8], r[9], r.at(10)},
                           {4.06054, 12.8802, -30.5858, 16.7498}});
  }
  return table;
}

Table read_lime() {
  Table table;
  for (const std::vector<double>& r : csv_rows(lime_csv())) {
    table.centre_um.push_back(r.at(0));
    table.bands.push_back({{r[1], r[2], r[3], r[4]},
                           {r[5], r[6], r[7]},
                           {r[8], r[9], r[10], r[11]},
                           {r[12], r[13], r[14]},
                           {r[15], r[16], r[17], r.at(18)}});
  }
  return table;
}

const Table& table_of(DiscModel model) {
  static const Table rolo = read_rolo(), lime = read_lime();
  return model == DiscModel::rolo ? rolo : lime;
}

}  // namespace

std::span<const double> disc_bands_um(DiscModel model) { return table_of(model).centre_um; }

// Kieffer & Stone 2005, eq. (10).
double disc_reflectance(DiscModel model, std::size_t band, const DiscGeometry& at) {
  const Coefficients& k = table_of(model).bands.at(band);
  const double g = at.phase_deg, r = g * kRadiansPerDegree, sun = at.sun_lon_deg * kRadiansPerDegree, sun2 = sun * sun;
  const double lat = at.observer_lat_deg, lon = at.observer_lon_deg;
  const double phase = k.a[0] + r * (k.a[1] + r * (k.a[2] + r * k.a[3]));
  const double waxing = sun * (k.b[0] + sun2 * (k.b[1] + sun2 * k.b[2]));
  const double libration = k.c[0] * lat + k.c[1] * lon + sun * (k.c[2] * lat + k.c[3] * lon);
  const double residual =
      k.d[0] * std::exp(-g / k.p[0]) + k.d[1] * std::exp(-g / k.p[1]) + k.d[2] * std::cos((g - k.p[2]) / k.p[3]);
  return std::exp(phase + waxing + libration + residual);
}

double disc_reflectance_at(DiscModel model, double wavelength_um, const DiscGeometry& geometry) {
  const std::vector<double>& centre = table_of(model).centre_um;
  if (!(wavelength_um >= centre.front() && wavelength_um <= centre.back()))
    return std::numeric_limits<double>::quiet_NaN();
  const auto next = std::upper_bound(centre.begin() + 1, centre.end() - 1, wavelength_um);
  const auto k = static_cast<std::size_t>(next - centre.begin());
  const double share = (wavelength_um - centre[k - 1]) / (centre[k] - centre[k - 1]);
  return std::lerp(disc_reflectance(model, k - 1, geometry), disc_reflectance(model, k, geometry), share);
}

}  // namespace selenograph::engine
