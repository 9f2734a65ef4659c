#include "engine/visibility/points/disc_light.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "dem/base/vector_targets.h"
#include "dem/terrain/terrain.h"
#include "engine/visibility/points/trace.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/points/disc_light.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_DISC_LIGHT_SHARED
#define SELENOGRAPH_ENGINE_DISC_LIGHT_SHARED
namespace selenograph::engine {

// State of a lane: its planes face none, part or all of the disc.
constexpr std::int32_t kFacesNone = 0, kFacesPart = 1, kFacesAll = 2;

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Sets `facing` to the state of each lane, and the tilts of `lanes` from its planes. `top`: unit direction toward the
// upper end of the disc. A point sees nothing of the disc if the ray toward `top` passes through the Moon's core.
void ClassifyFacing(const SurfacePoints& p, const double* top, DiscLanes& lanes, std::int32_t* facing) {
  constexpr double kCore2 = dem::kCoreRadius_m * dem::kCoreRadius_m;
  const double sx = top[0], sy = top[1], sz = top[2];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = p.x[i];
    const double y = p.y[i];
    const double z = p.z[i];
    const double along = x * sx + y * sy + z * sz;
    const double off_axis2 = x * x + y * y + z * z - along * along, behind2 = along < 0 ? off_axis2 : kCore2;
    const float facet_across = lanes.facet.across[i];
    const float facet_upward = lanes.facet.upward[i];
    const float shading_across = lanes.shading.across[i];
    const float shading_upward = lanes.shading.upward[i];
    const float facet_span = std::sqrt(facet_across * facet_across + facet_upward * facet_upward);
    const float shading_span = std::sqrt(shading_across * shading_across + shading_upward * shading_upward);
    // A plane varies over the disc by up to its gradient's length, its span, from the middle.
    const float facet_middle = lanes.facet.middle[i];
    const float shading_middle = lanes.shading.middle[i];
    const std::int32_t all_or_part =
        facet_middle > facet_span && shading_middle > shading_span ? kFacesAll : kFacesPart;
    const std::int32_t state =
        facet_middle <= -facet_span || shading_middle <= -shading_span || behind2 < kCore2 ? kFacesNone : all_or_part;
    facing[i] = state;
    lanes.tilt_across[i] = shading_across / shading_middle;
    lanes.tilt_upward[i] = shading_upward / shading_middle;
  }
}

// Computes the planes of sixteen normals. axes: toward the Sun; across and upward, multiplied by the radius.
void PlanesOf(const double* nx, const double* ny, const double* nz, const double (*axes)[3], DiscPlanes& out) {
  const double *t = axes[0], *a = axes[1], *u = axes[2];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = nx[i], y = ny[i], z = nz[i];
    out.middle[i] = static_cast<float>(x * t[0] + y * t[1] + z * t[2]);
    out.across[i] = static_cast<float>(x * a[0] + y * a[1] + z * a[2]);
    out.upward[i] = static_cast<float>(x * u[0] + y * u[1] + z * u[2]);
  }
}

// Minimum and maximum; the second argument if the first is NaN.
HWY_INLINE float min_number(float a, float b) { return a < b ? a : b; }
HWY_INLINE float max_number(float a, float b) { return a > b ? a : b; }

// Clips the range low to high of a column to the part where the linear function middle + slope y is positive.
HWY_INLINE void clip_to_positive(float middle, float slope, float& low, float& high) {
  constexpr float kFlat = 1e-12F;
  const float root = -middle / (slope > kFlat || slope < -kFlat ? slope : -kFlat);
  low = slope > 0 ? max_number(low, root) : low;
  high = slope > 0 ? high : min_number(high, root);
}

// Returns a table's value at a position in steps of the table, clamped to its first and last.
HWY_INLINE float interpolated(const float* table, float position) {
  const float low = position > 0 ? position : 0, at = low < DiscLight::Table::kSteps ? low : DiscLight::Table::kSteps;
  const auto i = static_cast<std::int32_t>(at);
  return table[i] + (at - static_cast<float>(i)) * (table[i + 1] - table[i]);
}

// Computes the remaining factors of points that all face the whole disc: per column, the light above the horizon and
// its moment, which the tilt turns into the cosine. kEven: the disc has no limb darkening, so both are closed forms.
template <bool kEven>
HWY_INLINE void remaining_of_full(const DiscLight::Table& table, const float* columns, const float (*horizons)[kPacket],
                                  const DiscLanes& disc_lanes, float* share_factor, float* cosine_factor) {
  alignas(64) float share[kPacket] = {};
  alignas(64) float cosine[kPacket] = {};
  for (int j = 0; j < DiscLight::kColumns; ++j) {
    const float x = columns[j];
    const float half = table.half[j];
    const float weight = table.weight[j];
    const float steps = 0.5F * DiscLight::Table::kSteps / half;
    const float per_length = 0.5F / half;
    const float *above_table = table.above[j], *moment_table = table.moment[j];
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < kPacket; ++i) {
      const float low = max_number(-half, min_number(half, horizons[j][i]));
      float light = 0, moment_above = 0;
      if constexpr (kEven) {
        light = (half - low) * per_length;
        moment_above = 0.5F * (half * half - low * low) * per_length;
      } else {
        light = interpolated(above_table, (low + half) * steps);
        moment_above = interpolated(moment_table, (low + half) * steps);
      }
      share[i] += weight * light;
      cosine[i] +=
          weight * (light + (disc_lanes.tilt_across[i] * x * light + disc_lanes.tilt_upward[i] * moment_above));
    }
  }
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    share_factor[i] = min_number(1, max_number(0, share[i]));
    cosine_factor[i] = min_number(1, max_number(0, cosine[i]));
  }
}

void RemainingOfFull(const DiscLight::Table& table, const float* columns, const float (*horizons)[kPacket],
                     const DiscLanes& disc_lanes, float* share_factor, float* cosine_factor) {
  if (table.even)
    remaining_of_full<true>(table, columns, horizons, disc_lanes, share_factor, cosine_factor);
  else
    remaining_of_full<false>(table, columns, horizons, disc_lanes, share_factor, cosine_factor);
}

// Computes the remaining factors of points that may face only part of the disc: the light above the horizon divided by
// the light without one (all_share, all_cosine). In each column, light reaches the facet from `low` to `high`, and
// counts in the cosine from bright_low to bright_high, where the shading normal faces it, too.
void RemainingOf(const DiscLight::Table& table, const float* columns, const float (*horizons)[kPacket],
                 const DiscLanes& disc_lanes, float* share_factor, float* cosine_factor) {
  const DiscPlanes &facet = disc_lanes.facet, &shading = disc_lanes.shading;
  alignas(64) float share[kPacket] = {};
  alignas(64) float cosine[kPacket] = {};
  alignas(64) float all_share[kPacket] = {};
  alignas(64) float all_cosine[kPacket] = {};
  for (int j = 0; j < DiscLight::kColumns; ++j) {
    const float x = columns[j];
    const float half = table.half[j];
    const float weight = table.weight[j];
    const float steps = 0.5F * DiscLight::Table::kSteps / half;
    const float *above = table.above[j], *moment = table.moment[j];
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < kPacket; ++i) {
      float low = -half, high = half;
      clip_to_positive(facet.middle[i] + facet.across[i] * x, facet.upward[i], low, high);
      float bright_low = low, bright_high = high;
      const float cosine_middle = shading.middle[i] + shading.across[i] * x, cosine_slope = shading.upward[i];
      clip_to_positive(cosine_middle, cosine_slope, bright_low, bright_high);
      // Light between two positions of the column: the light above the lower one minus the light above the upper one.
      const auto between = [&](const float* table_row, float from, float to) {
        const float first = from < to ? from : to;
        return interpolated(table_row, (first + half) * steps) - interpolated(table_row, (to + half) * steps);
      };
      const float horizon = horizons[j][i];
      share[i] += weight * between(above, max_number(low, horizon), high);
      all_share[i] += weight * between(above, low, high);
      const float free = max_number(bright_low, horizon);
      cosine[i] += weight * (cosine_middle * between(above, free, bright_high) +
                             cosine_slope * between(moment, free, bright_high));
      all_cosine[i] += weight * (cosine_middle * between(above, bright_low, bright_high) +
                                 cosine_slope * between(moment, bright_low, bright_high));
    }
  }
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float s = share[i] / (all_share[i] > 1e-6F ? all_share[i] : 1e-6F);
    const float c = cosine[i] / (all_cosine[i] > 1e-9F ? all_cosine[i] : 1e-9F);
    share_factor[i] = min_number(1, max_number(0, s));
    cosine_factor[i] = min_number(1, max_number(0, c));
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(ClassifyFacing);
HWY_EXPORT(PlanesOf);
HWY_EXPORT(RemainingOfFull);
HWY_EXPORT(RemainingOf);

namespace {

constexpr double kPi = std::numbers::pi;

// Returns the square of the radius, relative to that of the disc, that contains a share of its light. Brightness at r
// is 1 - u (1 - sqrt(1 - r^2)).
double radius2_of(double share, double u) {
  if (u == 0) return share;
  const auto light_inside = [u](double s) { return (1 - u) * s + u * (2.0 / 3) * (1 - std::pow(1 - s, 1.5)); };
  const double target = share * (1 - u / 3);
  double low = 0, high = 1;
  for (int i = 0; i < 60; ++i) (light_inside((low + high) / 2) < target ? low : high) = (low + high) / 2;
  return (low + high) / 2;
}

// Light of part of the disc, and the moment of that light about the middle (its integral times the height).
struct Segment {
  double light, moment;
};
// Returns the segment above a chord at height h, in shares of the total light. u: limb darkening. A chord at height y
// holds (1 - u) 2 sqrt(1 - y^2) + u pi / 2 (1 - y^2) of pi (1 - u / 3).
Segment above_chord(double h, double u) {
  if (h <= -1) return {1, 0};
  if (h >= 1) return {0, 0};
  const double q2 = 1 - h * h;
  const double q = std::sqrt(q2);
  const double total = kPi * (1 - u / 3);
  return {((1 - u) * (std::acos(h) - h * q) + u * kPi / 2 * (2.0 / 3 - h + h * h * h / 3)) / total,
          ((1 - u) * 2.0 / 3 * q2 * q + u * kPi / 8 * q2 * q2) / total};
}

// Returns light and moment above y in a column of half the length c, not normalised.
Segment above_in_column(double y, double c, double u) {
  const double q2 = std::max(0.0, c * c - y * y);
  const double q = std::sqrt(q2);
  if (u == 0) return {c - y, q2 / 2};
  return {(1 - u) * (c - y) + u * 0.5 * (c * c * std::acos(std::clamp(y / c, -1.0, 1.0)) - y * q),
          (1 - u) * q2 / 2 + u * q2 * q / 3};
}

}  // namespace

DiscLight::DiscLight(const Sun& sun, const Vec3& up)
    : toward_(sun.direction),
      radius_(std::tan(sun.angular_radius_deg * kRadiansPerDegree)),
      darkening_(sun.limb_darkening.value_or(0)),
      columns_(),
      table_(),
      fine_(),
      disc_points_(),
      directions_() {
  const Vec3 level = up.cross(toward_);
  across_ = level.norm() > 1e-6 * up.norm() ? level.normalized() : any_across(toward_);
  upward_ = toward_.cross(across_);

  // Place the columns by Gauss-Chebyshev quadrature of the second kind: x = -cos(angle), with weights sin(angle)^2. The
  // light of a column, on an even disc proportional to its half length sin(angle), replaces one of the two sines.
  double sum = 0;
  std::array<double, kColumns> weights{};
  for (std::size_t j = 0; j < kColumns; ++j) {
    const double angle = (static_cast<double>(j) + 1) * kPi / (kColumns + 1);
    const double x = -std::cos(angle);
    const double c = std::sin(angle);
    columns_[j] = static_cast<float>(x);
    table_.half[j] = static_cast<float>(c);
    const double column_light = above_in_column(-c, c, darkening_).light;
    sum += weights[j] = c * column_light;
    for (std::size_t k = 0; k <= Table::kSteps; ++k) {
      const Segment s = above_in_column(c * (2.0 * static_cast<double>(k) / Table::kSteps - 1), c, darkening_);
      table_.above[j][k] = static_cast<float>(s.light / column_light);
      table_.moment[j][k] = static_cast<float>(s.moment / column_light);
    }
    table_.above[j][Table::kSteps + 1] = table_.moment[j][Table::kSteps + 1] = 0;
  }
  for (std::size_t j = 0; j < kColumns; ++j) table_.weight[j] = static_cast<float>(weights[j] / sum);

  table_.even = darkening_ == 0;

  double fine_light = 0;
  for (std::size_t j = 0; j < kFine; ++j) {
    const double angle = (static_cast<double>(j) + 1) * kPi / (kFine + 1);
    const double c = std::sin(angle);
    fine_[j] = {std::cos(angle), c, c};
    fine_light += c * above_in_column(-c, c, darkening_).light;
  }
  for (FineColumn& column : fine_) column.weight /= fine_light;

  // Vogel's sunflower (1979): equal light per point, and no two points in line with a straight shadow edge. Put the
  // thirteen outermost points, the rim, directly after the middle: successive ones are 137.5 degrees apart, and the
  // largest gap between thirteen of them is 34 degrees.
  for (std::size_t k = 0; k < kDirections; ++k) {
    constexpr std::size_t kRim = kScouts - 1;
    const std::size_t n = k == 0 ? 0 : k <= kRim ? kDirections - k : k - kRim;
    const double r = std::sqrt(radius2_of((static_cast<double>(n) + 0.5) / kDirections, darkening_));
    const double angle = static_cast<double>(n) * kPi * (3 - std::sqrt(5.0));
    disc_points_[k] = {r * std::cos(angle), r * std::sin(angle)};
    directions_[k] = direction(disc_points_[k].across, disc_points_[k].upward);
  }
}

Vec3 DiscLight::direction(double across, double upward) const {
  return (toward_ + radius_ * (across * across_ + upward * upward_)).normalized();
}

// Faster than std::hypot, which guards against overflow.
static double length(double x, double y) { return std::sqrt(x * x + y * y); }

DiscShare DiscLight::unoccluded(const DiscPlane& facet, const DiscPlane& shading) const {
  const double facet_span = length(facet.across, facet.upward);
  if (facet.middle <= -facet_span) return {};
  // The facet's own plane cuts the disc in a chord, and light reaches it from above: (x, y) is the direction on the
  // disc in which the facet faces it more, h the height of the chord in that direction.
  const double h = facet_span > 0 ? -facet.middle / facet_span : -1;
  const double x = facet_span > 0 ? facet.across / facet_span : 0;
  const double y = facet_span > 0 ? facet.upward / facet_span : 0;
  const Segment segment = above_chord(h, darkening_);
  const double shading_along = shading.across * x + shading.upward * y;
  const double shading_span = length(shading.across, shading.upward);
  if (shading.middle >= shading_span)  // the shading normal faces the whole disc
    return {segment.light, shading.middle * segment.light + shading_along * segment.moment};
  if (shading.middle <= -shading_span) return {segment.light, 0};
  if (h <= -1 || std::abs(shading.across * y - shading.upward * x) <= 1e-9 * shading_span) {
    // One chord bounds the light of both normals.
    const double shading_h = -shading.middle / shading_span;
    if (h <= -1 || shading_along > 0) {
      const Segment b = above_chord(std::max(h, shading_h), darkening_);
      return {segment.light, shading.middle * b.light + shading_span * b.moment};
    }
  }
  // Two chords bound the light, the facet's and the shading normal's: integrate over columns in the direction (x, y).
  double cosine = 0;
  const double shading_aside = shading.upward * x - shading.across * y;  // component across the direction (x, y)
  for (const FineColumn& column : fine_) {
    const double cosine_at_column = shading.middle + shading_aside * column.across, c = column.half;
    double low = std::clamp(h, -c, c);
    double high = c;
    // Keep the part where the cosine, cosine_at_column + shading_along y, is positive.
    if (shading_along > 0)
      low = std::max(low, -cosine_at_column / shading_along);
    else if (shading_along < 0)
      high = std::min(high, -cosine_at_column / shading_along);
    else if (cosine_at_column <= 0)
      continue;
    if (!(low < high)) continue;
    const Segment from = above_in_column(low, c, darkening_), to = above_in_column(high, c, darkening_);
    cosine += column.weight * (cosine_at_column * (from.light - to.light) + shading_along * (from.moment - to.moment));
  }
  return {segment.light, cosine};
}

std::uint32_t DiscLight::unoccluded(const SurfacePoints& points, Shading& shading, DiscLanes& out, float* lit) const {
  double axes[3][3], top[3];
  const Vec3 upper = direction(0, 1);
  for (int k = 0; k < 3; ++k) {
    axes[0][k] = toward_[k];
    axes[1][k] = radius_ * across_[k];
    axes[2][k] = radius_ * upward_[k];
    top[k] = upper[k];
  }
  HWY_DYNAMIC_DISPATCH(PlanesOf)(points.nx, points.ny, points.nz, axes, out.facet);
  HWY_DYNAMIC_DISPATCH(PlanesOf)(shading.nx, shading.ny, shading.nz, axes, out.shading);
  alignas(64) std::int32_t facing[kPacket];
  HWY_DYNAMIC_DISPATCH(ClassifyFacing)(points, top, out, facing);
  std::uint32_t lit_lanes = 0;
  out.facing_all = 0;
  for (int i = 0; i < kPacket; ++i) out.facing_all |= facing[i] == kFacesAll ? 1U << i : 0U;
  for (int i = 0; i < kPacket; ++i) {
    lit[i] = points.hit[i] && facing[i] == kFacesAll ? 1.F : 0.F;
    lit_lanes |= lit[i] > 0 ? 1U << i : 0U;
    if (!points.hit[i] || facing[i] != kFacesPart) continue;
    const DiscShare share = unoccluded(plane(points.facet_normal(i)), plane(shading.normal(i)));
    if (!(share.share > 0 && share.cosine > 0)) continue;
    lit[i] = static_cast<float>(share.share);
    shading.incident[i] = share.cosine / share.share;
    lit_lanes |= 1U << i;
  }
  return lit_lanes;
}

void DiscLight::remaining(const float (*horizons)[kPacket], const DiscLanes& disc_lanes, float* share_factor,
                          float* cosine_factor) const {
  const auto kernel =
      disc_lanes.facing_all == kAllLanes ? HWY_DYNAMIC_DISPATCH(RemainingOfFull) : HWY_DYNAMIC_DISPATCH(RemainingOf);
  kernel(table_, columns_.data(), horizons, disc_lanes, share_factor, cosine_factor);
}

// Returns the light from the open directions as a share of that from all directions that the facet faces.
DiscShare DiscLight::ratio(const FreeDirections& open, const FreeDirections& faced, const DiscLanes& disc_lanes,
                           std::uint32_t lane) const {
  const DiscPlane shading = disc_lanes.shading.lane(lane);
  double faced_cosine = 0, open_cosine = 0;
  for (std::size_t k = 0; k < kDirections; ++k) {
    if (!faced[k]) continue;
    const double cosine = std::max(0.0, shading.at(disc_points_[k].across, disc_points_[k].upward));
    faced_cosine += cosine;
    if (open[k]) open_cosine += cosine;
  }
  const double share = static_cast<double>(open.count()) / static_cast<double>(faced.count());
  // A normal that faces less of the disc than the spacing of directions sees none of them: use the share.
  return {share, faced_cosine > 0 ? open_cosine / faced_cosine : share};
}

DiscShare DiscLight::remaining_with_objects(const FreeDirections& free, const float* horizons, std::size_t stride,
                                            const DiscLanes& disc_lanes, std::uint32_t lane) const {
  FreeDirections open;
  for (std::size_t k = 0; k < kDirections; ++k) {
    if (!free[k]) continue;
    // Interpolate the horizon between columns; outside the outermost columns it is constant.
    const auto x = static_cast<float>(disc_points_[k].across);
    std::size_t j = 0;
    while (j + 2 < kColumns && columns_[j + 1] < x) ++j;
    const float t = std::clamp((x - columns_[j]) / (columns_[j + 1] - columns_[j]), 0.F, 1.F);
    const float low = std::max(horizons[j * stride], -2.F);
    const float high = std::max(horizons[(j + 1) * stride], -2.F);
    open.set(k, disc_points_[k].upward > static_cast<double>(low + t * (high - low)));
  }
  return open.any() ? ratio(open, free, disc_lanes, lane) : DiscShare{};
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
