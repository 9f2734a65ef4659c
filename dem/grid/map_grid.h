// Map projections of the Moon's sphere. The formulas are Snyder's (Map Projections: A Working Manual, USGS Professional
// Paper 1395, 1987) on the sphere of 1 737 400 m; dem/gdal/geotiff_writer.h gives GDAL the same definitions.
#pragma once

#include <optional>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {

enum class MapProjection {
  equirectangular,      // Snyder 12, true to scale on the standard parallels
  polar_stereographic,  // Snyder 21, true to scale at the pole; longitude 0 points down in the north, up in the south
  orthographic          // Snyder 20, true to scale at its centre
};

// A point on the plane of a projection, m: x to the right, y up.
struct MapPoint {
  double x_m = 0, y_m = 0;
};

struct MapPlane {
  MapProjection projection = MapProjection::equirectangular;
  // The projection's origin. Equirectangular: latitude 0 and the central meridian; polar: 90 or -90, and 0.
  double lat_deg = 0, lon_deg = 0;
  double standard_parallel_deg = 0;  // for equirectangular

  // Empty on the far side of an orthographic map, and at the other pole of a stereographic one.
  std::optional<MapPoint> place(double lat_deg, double lon_deg) const;
};

// Inverse projection.
class MapDirections {
 public:
  explicit MapDirections(const MapPlane& plane);
  // Unit vector from the Moon's centre; empty where the plane has no point of the Moon.
  std::optional<Vec3> operator()(const MapPoint& point) const;

 private:
  std::optional<Vec3> from_equirectangular(const MapPoint& p) const;
  Vec3 from_stereographic(const MapPoint& p) const;
  std::optional<Vec3> from_orthographic(const MapPoint& p) const;

  MapPlane plane_;
  double metres_per_degree_;  // metres per degree of longitude
  EastNorthUp axes_;          // axes at the projection's origin; at a pole along its central meridian
};

// A raster on the projection's plane: square pixels, row 0 in the north.
struct MapGrid {
  MapPlane plane;
  double west_m = 0, north_m = 0;  // outer corner of the first pixel
  double gsd_m = 1;                // side of a pixel
  int width = 0, height = 0;

  // Position of a pixel's centre.
  MapPoint point(int column, int row) const { return {west_m + (column + 0.5) * gsd_m, north_m - (row + 0.5) * gsd_m}; }
};

}  // namespace selenograph::dem
