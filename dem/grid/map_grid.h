// Map projections of the Moon's sphere. The formulas are Snyder's (Map Projections: A Working Manual, USGS Professional
// Paper 1395, 1987) on the sphere of 1 737 400 m; dem/gdal translates the definitions to and from GDAL's.
#pragma once

#include <optional>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {

enum class MapProjection {
  equirectangular,     // Snyder 12, true to scale on the standard parallels
  stereographic,       // Snyder 21; from a pole its central meridian points down in the north, up in the south
  orthographic,        // Snyder 20, true to scale at its centre
  mercator,            // Snyder 7
  transverse_mercator  // Snyder 8
};

// A point on the plane of a projection, m: x to the right, y up.
struct MapPoint {
  double x_m = 0, y_m = 0;
};

struct MapPlane {
  MapProjection projection = MapProjection::equirectangular;
  // The projection's origin. Equirectangular and Mercator: latitude 0 and the central meridian.
  double lat_deg = 0, lon_deg = 0;
  double standard_parallel_deg = 0;  // equirectangular only
  // k0, lengths on the plane over lengths on the ground: at the origin (stereographic), at the equator (Mercator), on
  // the central meridian (transverse Mercator).
  double scale = 1;

  bool operator==(const MapPlane&) const = default;
};

// A projection and its inverse.
class MapTransform {
 public:
  explicit MapTransform(const MapPlane& plane);

  // Projects a position. Empty on the far side of an orthographic map, and where the map would be infinitely large:
  // opposite to the origin of a stereographic one, at the poles of Mercator, 90 degrees east and west of the origin of
  // transverse Mercator.
  std::optional<MapPoint> project(double lat_deg, double lon_deg) const;
  // Projects a direction, a unit vector from the Moon's centre.
  std::optional<MapPoint> project(const Vec3& direction) const;

  // Returns the unit vector from the Moon's centre to a point; empty where the plane has no point of the Moon.
  std::optional<Vec3> direction(const MapPoint& point) const;

 private:
  std::optional<Vec3> from_equirectangular(const MapPoint& p) const;
  Vec3 from_stereographic(const MapPoint& p) const;
  std::optional<Vec3> from_orthographic(const MapPoint& p) const;
  Vec3 from_cylinder(double around_m, double along_m, const Vec3& east, const Vec3& axis) const;

  MapPlane plane_;
  double metres_per_degree_;  // metres per degree of longitude
  double radius_m_;           // radius of the sphere times k0
  EastNorthUp axes_;          // axes at the projection's origin; at a pole along its central meridian
};

// A raster on the projection's plane: square pixels, row 0 in the north.
struct MapGrid {
  MapPlane plane;
  double west_m = 0, north_m = 0;  // outer corner of the first pixel
  double gsd_m = 1;                // side of a pixel
  int width = 0, height = 0;

  // Returns the position of a pixel's centre.
  MapPoint point(int column, int row) const { return {west_m + (column + 0.5) * gsd_m, north_m - (row + 0.5) * gsd_m}; }
};

}  // namespace selenograph::dem
