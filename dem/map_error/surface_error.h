// A map's errors at single places: where its ground comes from, and what its heights, normals and albedo become.
#pragma once

#include <optional>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/block.h"
#include "dem/grid/geodesy.h"
#include "dem/map_error/gaussian_field.h"
#include "dem/map_error/map_error.h"
#include "dem/value_maps/value_map.h"

namespace selenograph::dem {

// Thread-safe: const functions may be called concurrently, each with cursors of its own.
class SurfaceError {
 public:
  explicit SurfaceError(const MapError& error);

  const MapError& error() const { return error_; }

  // Returns the direction of the true ground that the map shows at a direction. Both are unit vectors, MOON_ME.
  Vec3 true_direction(const Vec3& map_direction) const { return true_from_map_ * map_direction; }
  // Returns where the map shows a normal of the true ground.
  Vec3 map_normal(const Vec3& true_normal) const { return true_from_map_.transpose_times(true_normal); }

  struct Ground {
    double height_m;
    Vec3 normal;    // unit, MOON_ME
    double albedo;  // factor
  };
  struct Cursors {
    std::vector<GaussianField::Cursor> height, albedo;
    std::vector<std::optional<ValueMap::Sampler>> layers;  // of heights
  };
  // `stop` must outlive the cursors.
  Cursors cursors(const StopToken& stop) const;
  // Applies scale, tilt and the random fields to the ground that the map shows at a direction. Throws DataError where a
  // layer's file cannot be read, Cancelled when the cursors' `stop` is requested.
  Ground apply(const Vec3& direction, const Ground& ground, Cursors& cursors) const;

  bool changes_albedo() const { return !albedo_.empty(); }
  // Returns bounds on the heights that ground between two heights gets within `radius_m` of a direction.
  HeightRange bounds(const HeightRange& ground, const Vec3& direction, double radius_m) const;
  // Returns a bound on the vertical distance between a level's surface and finer ones that the added heights cause.
  double left_out_m(int level) const;
  // Returns the coarsest level whose posts are at most half a correlation length apart, for the shortest one. Linear
  // interpolation between such posts misses 1 % of the field's variance.
  int finest_level() const { return finest_level_; }

 private:
  struct Added {
    double height_m;
    Vec3 gradient;  // on the sphere of the datum, per metre
  };
  Added tilt_at(const Vec3& direction) const;
  Added field_at(std::size_t i, const Vec3& direction, Cursors& cursors) const;

  MapError error_;
  Mat3 true_from_map_;
  Vec3 about_, uphill_;  // unit: the place, and the tilt's direction there
  double tilt_slope_;    // tangent of the tilt's slope
  std::vector<GaussianField> height_, albedo_;
  int finest_level_;
};

}  // namespace selenograph::dem
