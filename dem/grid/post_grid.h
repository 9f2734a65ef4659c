// Grid of a raster's posts: multiples of a step in degrees, or squares on the plane of a map projection.
#pragma once

#include <optional>
#include <variant>

#include "dem/grid/map_grid.h"

namespace selenograph::dem {

// Column and row of a post; fractional for a position between posts. Post (0, 0) is the first one of the file.
struct PostXY {
  double x, y;
};

// Footprint in degrees of the area where posts are: south <= north; west in [-180, 180), east in (west, west + 360].
struct Footprint {
  double south_deg = 0, north_deg = 0, west_deg = 0, east_deg = 0;
};

// Posts at latitude first_lat - row / ppd and longitude first_lon + column / ppd, degrees.
struct GeographicGrid {
  double first_lat_deg = 0, first_lon_deg = 0;
  double lat_posts_per_degree = 0, lon_posts_per_degree = 0;
};

// Posts at x = first_x + column * spacing, y = first_y - row * spacing on a plane (of any projection but
// equirectangular: that is a GeographicGrid).
struct PlaneGrid {
  MapPlane plane;
  double first_x_m = 0, first_y_m = 0, spacing_m = 0;
};

using PostGrid = std::variant<GeographicGrid, PlaneGrid>;

// Returns n of the 2^-n degree lattice on which all posts lie exactly, if there is one. `posts_along`: posts of the
// longer side.
std::optional<int> lattice_level_of(const GeographicGrid& grid, int posts_along);

// The posts of a raster on a plane.
class PlanePosts {
 public:
  PlanePosts(const PlaneGrid& grid, int width, int height);

  // Returns the column and row of a position. A position that the plane does not show is far outside any raster (-1e9).
  PostXY locate(double lat_deg, double lon_deg) const { return posts_at(transform_.project(lat_deg, lon_deg)); }
  // Returns the column and row of a direction, a unit vector from the Moon's centre.
  PostXY locate(const Vec3& direction) const { return posts_at(transform_.project(direction)); }

  // Inverse of locate(); height_m is 0. Beyond the limb of an orthographic plane, it returns the nearest point of the
  // limb.
  Geographic position(double x, double y) const;

  // Returns whether a post is on the Moon. Posts in the corners of an orthographic map of a hemisphere are not.
  bool on_moon(double x, double y) const { return within_limb(at(x, y)); }

  // Returns the density of posts at the origin of an azimuthal projection. For a cylindrical one (Mercator, transverse
  // Mercator) it is that in the raster's middle, which may lie far from the line where the cylinder touches the sphere.
  double posts_per_degree() const;

  // Returns the footprint of the posts on the Moon; there must be at least one.
  Footprint footprint() const;

 private:
  MapPoint at(double x, double y) const {
    return {grid_.first_x_m + x * grid_.spacing_m, grid_.first_y_m - y * grid_.spacing_m};
  }
  PostXY posts_at(const std::optional<MapPoint>& p) const;
  bool within_limb(const MapPoint& p) const;
  Geographic position_at(const MapPoint& p) const;
  Geographic border(double t) const;
  bool contains(double x, double y) const;

  PlaneGrid grid_;
  double columns_, rows_;  // number of steps from the first post to the last
  MapTransform transform_;
  MapPoint period_;  // distance in m after which the plane repeats; 0: it does not
};

}  // namespace selenograph::dem
