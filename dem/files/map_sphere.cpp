#include "dem/files/map_sphere.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "dem/base/error.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

constexpr double kSameRadius_m = 0.5;  // tolerance: labels round radii
constexpr double kAnyRadius_m = 1000;  // tolerance around the Moon's radius: spheres in use have 1737 to 1738.14 km

}  // namespace

double map_sphere_m(std::span<const double> semi_axes_m, const std::string& path) {
  const auto [smallest_m, largest_m] = std::ranges::minmax(semi_axes_m);
  if (!(std::abs(smallest_m - kMoonRadius_m) <= kAnyRadius_m && largest_m - smallest_m <= kSameRadius_m)) {
    std::string axes;
    for (const double axis_m : semi_axes_m) axes += fmt::format("{}{:.1f}", axes.empty() ? "" : " x ", axis_m);
    throw DataError(path,
                    fmt::format("its ellipsoid of {} m is not the Moon's sphere of {:.0f} m", axes, kMoonRadius_m));
  }
  const double radius_m = semi_axes_m.front();
  return std::abs(radius_m - kMoonRadius_m) <= kSameRadius_m ? kMoonRadius_m : radius_m;
}

void check_vertical_datum(double sphere_m, bool holds_radii, const std::string& path) {
  if (sphere_m == kMoonRadius_m || holds_radii) return;
  throw DataError(
      path, fmt::format("its sphere of {:.1f} m is not the Moon's sphere of {:.0f} m, and whether its heights are "
                        "above that sphere is not known. Convert them to planetary radii (add {:.1f} if "
                        "they are), or to heights above {:.0f} m on that sphere",
                        sphere_m, kMoonRadius_m, sphere_m, kMoonRadius_m));
}

}  // namespace selenograph::dem
