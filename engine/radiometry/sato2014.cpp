#include "engine/radiometry/sato2014.h"

#include <array>
#include <vector>

#include "engine/support/csv.h"
#include "engine/support/interpolate.h"

namespace selenograph::engine {
namespace {

constexpr double kMeanSlope_deg = 23.657;

struct Row {
  double wavelength_um, w, b, c, b0, h;
};
using Regions = std::array<std::vector<Row>, 4>;

Regions read_regions() {
  Regions regions;
  for (const std::vector<double>& r : csv_rows(sato2014_csv()))
    regions.at(static_cast<std::size_t>(r.at(0))).push_back({r[1], r[2], r[3], r[4], r[5], r.at(6)});
  return regions;
}

}  // namespace

HapkeParameters sato2014(SatoRegion region, double wavelength_um) {
  static const Regions regions = read_regions();
  const std::vector<Row>& rows = regions.at(static_cast<std::size_t>(region));
  const auto at = [&](double Row::*value) { return interpolated(rows, wavelength_um, &Row::wavelength_um, value); };
  HapkeParameters out;
  out.w = at(&Row::w);
  out.b = at(&Row::b);
  out.c = at(&Row::c);
  out.b0 = at(&Row::b0);
  out.h = at(&Row::h);
  out.phase_function = PhaseFunction::double_henyey_greenstein;
  out.theta_bar_deg = kMeanSlope_deg;
  return out;
}

}  // namespace selenograph::engine
