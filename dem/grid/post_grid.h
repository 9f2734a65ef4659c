// Grid of a raster's posts: multiples of a step in degrees, or squares on a polar stereographic plane.
#pragma once

#include <optional>
#include <variant>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {

// Column and row of a post; fractional for a place between posts. Post (0, 0) is the first one of the file.
struct PostXY {
  double x, y;
};

// Posts at latitude first_lat - row / ppd and longitude first_lon + column / ppd, degrees.
struct GeographicGrid {
  double first_lat_deg = 0, first_lon_deg = 0;
  double lat_posts_per_degree = 0, lon_posts_per_degree = 0;
};

// Posts at X = first_x + column * spacing, Y = first_y - row * spacing in a polar stereographic plane of the sphere.
// Snyder, Map Projections - A Working Manual (USGS PP 1395, 1987), equations 21-5 to 21-12:
// X = rho sin(lon - lon0), Y = -+ rho cos(lon - lon0) (north -, south +), rho = 2 R k0 tan(colatitude / 2).
struct PolarGrid {
  bool north = true;
  double central_lon_deg = 0;
  double scale = 1;  // k0, at the pole
  double first_x_m = 0, first_y_m = 0, spacing_m = 0;
};

using PostGrid = std::variant<GeographicGrid, PolarGrid>;

// n of the 2^-n degree lattice on which all posts lie exactly, if there is one; `posts_along`: posts of the longer
// side.
std::optional<int> lattice_level_of(const GeographicGrid& grid, int posts_along);

PostXY locate(const PolarGrid& grid, double lat_deg, double lon_deg);
// Geographic coordinates of a place on the plane; height_m is 0.
Geographic place_on(const PolarGrid& grid, double x_m, double y_m);

}  // namespace selenograph::dem
