#include "dem/map_error/surface_error.h"

#include <algorithm>
#include <cmath>

#include "dem/base/noise.h"
#include "dem/grid/lattice.h"
#include "dem/grid/rotation.h"

namespace selenograph::dem {
namespace {

// Returns the fields of a list; `first` numbers the first of them, so that no two fields of a map share their deviates.
std::vector<GaussianField> fields_of(const std::vector<MapError::Field>& list, std::uint64_t seed,
                                     std::uint64_t first) {
  std::vector<GaussianField> fields;
  fields.reserve(list.size());
  for (const MapError::Field& field : list)
    fields.emplace_back(field.standard_deviation, field.correlation_length_m,
                        split_mix(seed + kSplitMixStep) + kSplitMixStep * first++);
  return fields;
}

// Returns the rotation that takes directions of the map to those of the true ground that it shows there.
Mat3 rotation_of(const MapError& error, const EastNorthUp& axes) {
  if (!error.is_shifted()) return Mat3::identity();
  const Vec3 shift_m = error.shift.east_m * axes.east + error.shift.north_m * axes.north;
  const AngleAxis map_from_true(shift_m.norm() / kMoonRadius_m, axes.up.cross(shift_m).normalized());
  return map_from_true.matrix().transpose();
}

int level_resolving(const std::vector<MapError::Field>& fields) {
  int level = 0;
  for (const MapError::Field& field : fields)
    while (level < kMaxLevel && post_spacing_m(level) > field.correlation_length_m / 2) ++level;
  return level;
}

}  // namespace

SurfaceError::SurfaceError(const MapError& error)
    : error_(error),
      height_(fields_of(error.height, error.seed, 0)),
      albedo_(fields_of(error.albedo, error.seed, 1000)),
      finest_level_(std::max(level_resolving(error.height), level_resolving(error.albedo))) {
  const EastNorthUp axes = local_axes(error.about.lat_deg, error.about.lon_deg);
  const double azimuth = error.tilt.azimuth_deg * kRadiansPerDegree;
  about_ = axes.up;
  uphill_ = std::cos(azimuth) * axes.north + std::sin(azimuth) * axes.east;
  tilt_slope_ = std::tan(error.tilt.slope_deg * kRadiansPerDegree);
  true_from_map_ = rotation_of(error, axes);
}

// Differentiates slope * u * exp(-c^2 / (2 reach^2)), with u the distance uphill and c the chord from `about`.
SurfaceError::Added SurfaceError::tilt_at(const Vec3& direction) const {
  if (tilt_slope_ == 0) return {0, Vec3::zero()};
  constexpr double kReachSquare_m2 = MapError::kTiltReach_m * MapError::kTiltReach_m;
  const Vec3 from_about_m = kMoonRadius_m * (direction - about_);
  const double uphill_m = kMoonRadius_m * direction.dot(uphill_);
  const double faded = tilt_slope_ * std::exp(-from_about_m.squared_norm() / (2 * kReachSquare_m2));
  return {faded * uphill_m, faded * (uphill_ - uphill_m / kReachSquare_m2 * from_about_m)};
}

SurfaceError::Cursors SurfaceError::cursors(const StopToken& stop) const {
  Cursors cursors{
      std::vector<GaussianField::Cursor>(height_.size()), std::vector<GaussianField::Cursor>(albedo_.size()), {}};
  for (const MapError::Field& field : error_.height) {
    auto& layer = cursors.layers.emplace_back();
    if (field.layer.content) layer.emplace(*field.layer.content, stop);
  }
  return cursors;
}

// A layer multiplies the field by its share of the largest standard deviation; its slope is taken over 20 m.
SurfaceError::Added SurfaceError::field_at(std::size_t i, const Vec3& direction, Cursors& cursors) const {
  const GaussianField::Sample sample = height_[i].at(kMoonRadius_m * direction, cursors.height[i]);
  if (!cursors.layers[i]) return {sample.value, sample.gradient};
  const auto share_at = [&](const Vec3& toward) {
    const Geographic at = to_geographic(toward);
    const double m = cursors.layers[i]->mean({at.lat_deg, at.lon_deg, {0, 0}, {0, 0}}).value;
    return m > 0 ? std::min(m / height_[i].standard_deviation(), 1.0) : 0.0;
  };
  const EastNorthUp axes = local_axes(direction);
  constexpr double kStep = 10 / kMoonRadius_m;
  Vec3 slope = Vec3::zero();
  for (const Vec3& along : {axes.east, axes.north})
    slope += (share_at(direction + kStep * along) - share_at(direction - kStep * along)) / (2 * kStep * kMoonRadius_m) *
             along;
  const double share = share_at(direction);
  return {share * sample.value, share * sample.gradient + sample.value * slope};
}

SurfaceError::Ground SurfaceError::apply(const Vec3& direction, const Ground& ground, Cursors& cursors) const {
  constexpr double kMargin_m = 1, kMaxAlbedo = 3.99;  // a post at a bound of lunar relief counts as no-data
  const double about_m = error_.about.height_m;
  Added added = tilt_at(direction);
  const Vec3 on_sphere_m = kMoonRadius_m * direction;
  for (std::size_t i = 0; i < height_.size(); ++i) {
    const Added field = field_at(i, direction, cursors);
    added.height_m += field.height_m;
    added.gradient += field.gradient;
  }
  double albedo = 1;
  for (std::size_t i = 0; i < albedo_.size(); ++i) albedo += albedo_[i].at(on_sphere_m, cursors.albedo[i]).value;
  const double height_m = std::clamp(about_m + error_.scale * (ground.height_m - about_m) + added.height_m,
                                     double{kLowestRelief_m} + kMargin_m, double{kHighestRelief_m} - kMargin_m);
  // Add slopes: a normal n has the gradient -(n - (n up) up) / (n up). Overhangs, which have none, keep their normal.
  const double upward = ground.normal.dot(direction);
  Vec3 normal = ground.normal;
  if (upward > 0) {
    const Vec3 ground_gradient = direction - ground.normal / upward;
    const Vec3 added_gradient =
        kMoonRadius_m / (kMoonRadius_m + height_m) * (added.gradient - added.gradient.dot(direction) * direction);
    normal = (direction - error_.scale * ground_gradient - added_gradient).normalized();
  }
  return {height_m, normal, std::clamp(ground.albedo * albedo, 0.0, kMaxAlbedo)};
}

HeightRange SurfaceError::bounds(const HeightRange& ground, const Vec3& direction, double radius_m) const {
  double margin_m = 1e-3 + std::abs(tilt_at(direction).height_m) + std::abs(tilt_slope_) * radius_m;
  for (const GaussianField& field : height_) margin_m += GaussianField::kMaxDeviations * field.standard_deviation();
  const auto scaled = [&](float height_m) {
    return error_.about.height_m + error_.scale * (double{height_m} - error_.about.height_m);
  };
  return {std::max(static_cast<float>(scaled(ground.low) - margin_m), kLowestRelief_m),
          std::min(static_cast<float>(scaled(ground.high) + margin_m), kHighestRelief_m)};
}

// Between posts d apart, a surface deviates from its triangles by at most d^2 / 8 times its curvature along each axis.
// A field's curvature has the standard deviation sqrt(12) sigma / L^2 along an axis.
double SurfaceError::left_out_m(int level) const {
  const double spacing_m = post_spacing_m(level);
  double bound_m = 3 * std::abs(tilt_slope_) * spacing_m * spacing_m / (4 * MapError::kTiltReach_m);
  for (const GaussianField& field : height_) {
    const double largest_m = GaussianField::kMaxDeviations * field.standard_deviation(),
                 ratio = spacing_m / field.correlation_length_m();
    bound_m += largest_m * std::min(2.0, std::sqrt(12.0) / 4 * ratio * ratio);
  }
  return bound_m;
}

}  // namespace selenograph::dem
