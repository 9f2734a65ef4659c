#include "engine/visibility/points/disc_light.h"

#include <Eigen/Geometry>
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

// How much of the disc a point's planes face.
constexpr std::int32_t kNone = 0, kSome = 1, kWhole = 2;

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// top: toward the disc's upper end. Sets how[i].
void LookAt(const SurfacePoints& p, const double* top, DiscLanes& lanes, std::int32_t* how) {
  constexpr double kCore2 = dem::kCoreRadius_m * dem::kCoreRadius_m;
  const double sx = top[0], sy = top[1], sz = top[2];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = p.x[i];
    const double y = p.y[i];
    const double z = p.z[i];
    const double along = x * sx + y * sy + z * sz;
    const double off_axis2 = x * x + y * y + z * z - along * along, behind2 = along < 0 ? off_axis2 : kCore2;
    const float a = lanes.facet.across[i];
    const float b = lanes.facet.upward[i];
    const float c = lanes.shading.across[i];
    const float d = lanes.shading.upward[i];
    const float facet = std::sqrt(a * a + b * b);
    const float shading = std::sqrt(c * c + d * d);
    const float m = lanes.facet.middle[i];
    const float n = lanes.shading.middle[i];
    const std::int32_t whole = m > facet && n > shading ? kWhole : kSome;
    const std::int32_t some = m <= -facet || n <= -shading || behind2 < kCore2 ? kNone : whole;
    how[i] = some;
    lanes.tilt_across[i] = c / n;
    lanes.tilt_upward[i] = d / n;
  }
}

// axes: toward, across, upward; radius included.
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

// Least and most with the second where the first is not a number.
HWY_INLINE float least(float a, float b) { return a < b ? a : b; }
HWY_INLINE float most(float a, float b) { return a > b ? a : b; }

// Where a plane is positive along a column: from low to high.
HWY_INLINE void bound(float middle, float slope, float& low, float& high) {
  constexpr float kFlat = 1e-12F;
  const float root = -middle / (slope > kFlat || slope < -kFlat ? slope : -kFlat);
  low = slope > 0 ? most(low, root) : low;
  high = slope > 0 ? high : least(high, root);
}

HWY_INLINE float looked_up(const float* table, float place) {
  const float low = place > 0 ? place : 0, at = low < DiscLight::Table::kSteps ? low : DiscLight::Table::kSteps;
  const auto i = static_cast<std::int32_t>(at);
  return table[i] + (at - static_cast<float>(i)) * (table[i + 1] - table[i]);
}

// Of points that face all of the disc.
template <bool kEven>
HWY_INLINE void left_of_whole(const DiscLight::Table& table, const float* columns, const float (*horizons)[kPacket],
                              const DiscLanes& turned, float* of_share, float* of_cosine) {
  alignas(64) float share[kPacket] = {};
  alignas(64) float cosine[kPacket] = {};
  for (int j = 0; j < DiscLight::kColumns; ++j) {
    const float x = columns[j];
    const float half = table.half[j];
    const float weight = table.weight[j];
    const float steps = 0.5F * DiscLight::Table::kSteps / half;
    const float per_length = 0.5F / half;
    const float *above = table.above[j], *moment = table.moment[j];
    SELENOGRAPH_INDEPENDENT_LANES
    for (int i = 0; i < kPacket; ++i) {
      const float low = most(-half, least(half, horizons[j][i]));
      float light = 0, lever = 0;
      if constexpr (kEven)
        light = (half - low) * per_length, lever = 0.5F * (half * half - low * low) * per_length;
      else {
        light = looked_up(above, (low + half) * steps);
        lever = looked_up(moment, (low + half) * steps);
      }
      share[i] += weight * light;
      cosine[i] += weight * (light + (turned.tilt_across[i] * x * light + turned.tilt_upward[i] * lever));
    }
  }
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i)
    of_share[i] = least(1, most(0, share[i])), of_cosine[i] = least(1, most(0, cosine[i]));
}

void LeftOfWhole(const DiscLight::Table& table, const float* columns, const float (*horizons)[kPacket],
                 const DiscLanes& turned, float* of_share, float* of_cosine) {
  if (table.even)
    left_of_whole<true>(table, columns, horizons, turned, of_share, of_cosine);
  else
    left_of_whole<false>(table, columns, horizons, turned, of_share, of_cosine);
}

void LeftOf(const DiscLight::Table& table, const float* columns, const float (*horizons)[kPacket],
            const DiscLanes& turned, float* of_share, float* of_cosine) {
  const DiscPlanes &facet = turned.facet, &shading = turned.shading;
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
      bound(facet.middle[i] + facet.across[i] * x, facet.upward[i], low, high);
      float bright_low = low, bright_high = high;
      const float here = shading.middle[i] + shading.across[i] * x, slope = shading.upward[i];
      bound(here, slope, bright_low, bright_high);
      // Light between two places of the column: what is above the one less what is above the other.
      const auto between = [&](const float* of, float from, float to) {
        const float first = from < to ? from : to;
        return looked_up(of, (first + half) * steps) - looked_up(of, (to + half) * steps);
      };
      const float horizon = horizons[j][i];
      share[i] += weight * between(above, most(low, horizon), high);
      all_share[i] += weight * between(above, low, high);
      const float free = most(bright_low, horizon);
      cosine[i] += weight * (here * between(above, free, bright_high) + slope * between(moment, free, bright_high));
      all_cosine[i] +=
          weight * (here * between(above, bright_low, bright_high) + slope * between(moment, bright_low, bright_high));
    }
  }
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float s = share[i] / (all_share[i] > 1e-6F ? all_share[i] : 1e-6F);
    const float c = cosine[i] / (all_cosine[i] > 1e-9F ? all_cosine[i] : 1e-9F);
    of_share[i] = least(1, most(0, s));
    of_cosine[i] = least(1, most(0, c));
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(LookAt);
HWY_EXPORT(PlanesOf);
HWY_EXPORT(LeftOfWhole);
HWY_EXPORT(LeftOf);

namespace {

constexpr double kPi = std::numbers::pi;

// (r / R)^2 within which lies a share of a disc's light, whose brightness is 1 - u (1 - sqrt(1 - (r / R)^2)).
double radius2_of(double share, double u) {
  if (u == 0) return share;
  const auto light_within = [u](double s) { return (1 - u) * s + u * (2.0 / 3) * (1 - std::pow(1 - s, 1.5)); };
  const double wanted = share * (1 - u / 3);
  double low = 0, high = 1;
  for (int i = 0; i < 60; ++i) (light_within((low + high) / 2) < wanted ? low : high) = (low + high) / 2;
  return (low + high) / 2;
}

// Above a chord at height h of the disc: of its light, and of the light's moment about the disc's middle. A chord at
// height y holds (1 - u) 2 sqrt(1 - y^2) + u pi / 2 (1 - y^2) of pi (1 - u / 3).
struct Segment {
  double light, moment;
};
Segment above_chord(double h, double u) {
  if (h <= -1) return {1, 0};
  if (h >= 1) return {0, 0};
  const double q2 = 1 - h * h;
  const double q = std::sqrt(q2);
  const double all = kPi * (1 - u / 3);
  return {((1 - u) * (std::acos(h) - h * q) + u * kPi / 2 * (2.0 / 3 - h + h * h * h / 3)) / all,
          ((1 - u) * 2.0 / 3 * q2 * q + u * kPi / 8 * q2 * q2) / all};
}

// In a column of half the length c: light and moment above y, not normalised.
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
      places_(),
      directions_() {
  const Vec3 level = up.cross(toward_);
  across_ = level.norm() > 1e-6 * up.norm() ? level.normalized() : any_across(toward_);
  upward_ = toward_.cross(across_);

  double sum = 0;
  std::array<double, kColumns> weights{};
  for (std::size_t j = 0; j < kColumns; ++j) {
    const double turn = (static_cast<double>(j) + 1) * kPi / (kColumns + 1);
    const double x = -std::cos(turn);
    const double c = std::sin(turn);
    columns_[j] = static_cast<float>(x);
    table_.half[j] = static_cast<float>(c);
    const double all = above_in_column(-c, c, darkening_).light;
    sum += weights[j] = c * all;
    for (std::size_t k = 0; k <= Table::kSteps; ++k) {
      const Segment s = above_in_column(c * (2.0 * static_cast<double>(k) / Table::kSteps - 1), c, darkening_);
      table_.above[j][k] = static_cast<float>(s.light / all);
      table_.moment[j][k] = static_cast<float>(s.moment / all);
    }
    table_.above[j][Table::kSteps + 1] = table_.moment[j][Table::kSteps + 1] = 0;
  }
  for (std::size_t j = 0; j < kColumns; ++j) table_.weight[j] = static_cast<float>(weights[j] / sum);

  table_.even = darkening_ == 0;

  double fine = 0;
  for (std::size_t j = 0; j < kFine; ++j) {
    const double turn = (static_cast<double>(j) + 1) * kPi / (kFine + 1);
    const double c = std::sin(turn);
    fine_[j] = {std::cos(turn), c, c};
    fine += c * above_in_column(-c, c, darkening_).light;
  }
  for (FineColumn& column : fine_) column.weight /= fine;

  // Vogel's sunflower (1979): equal light, no two places in line with a straight shadow edge. The last thirteen are
  // around the rim: successive ones are 137.5 degrees apart, the largest gap between thirteen of them is 34.
  for (std::size_t k = 0; k < kDirections; ++k) {
    constexpr std::size_t kRim = kScouts - 1;
    const std::size_t n = k == 0 ? 0 : k <= kRim ? kDirections - k : k - kRim;
    const double r = std::sqrt(radius2_of((static_cast<double>(n) + 0.5) / kDirections, darkening_));
    const double turn = static_cast<double>(n) * kPi * (3 - std::sqrt(5.0));
    places_[k] = {r * std::cos(turn), r * std::sin(turn)};
    directions_[k] = direction(places_[k].across, places_[k].upward);
  }
}

Vec3 DiscLight::direction(double across, double upward) const {
  return (toward_ + radius_ * (across * across_ + upward * upward_)).normalized();
}

// (std::hypot takes care of overflow, and its time.)
static double length(double x, double y) { return std::sqrt(x * x + y * y); }

DiscShare DiscLight::alone(const DiscPlane& facet, const DiscPlane& shading) const {
  const double reach = length(facet.across, facet.upward);
  if (facet.middle <= -reach) return {};
  // The facet's horizon is a chord at height h along the direction (x, y) in which the facet faces the disc more.
  const double h = reach > 0 ? -facet.middle / reach : -1;
  const double x = reach > 0 ? facet.across / reach : 0;
  const double y = reach > 0 ? facet.upward / reach : 0;
  const Segment s = above_chord(h, darkening_);
  const double along = shading.across * x + shading.upward * y;
  const double bright = length(shading.across, shading.upward);
  if (shading.middle >= bright)  // the normal faces all of the disc
    return {s.light, shading.middle * s.light + along * s.moment};
  if (shading.middle <= -bright) return {s.light, 0};
  if (h <= -1 || std::abs(shading.across * y - shading.upward * x) <= 1e-9 * bright) {
    // One chord bounds both.
    const double own = -shading.middle / bright;
    if (h <= -1 || along > 0) {
      const Segment b = above_chord(std::max(h, own), darkening_);
      return {s.light, shading.middle * b.light + bright * b.moment};
    }
  }
  // Two chords: by columns along the facet's.
  double cosine = 0;
  const double aside = shading.upward * x - shading.across * y;  // across the direction (x, y)
  for (const FineColumn& column : fine_) {
    const double here = shading.middle + aside * column.across, c = column.half;
    double low = std::clamp(h, -c, c);
    double high = c;
    if (along > 0)
      low = std::max(low, -here / along);
    else if (along < 0)
      high = std::min(high, -here / along);
    else if (here <= 0)
      continue;
    if (!(low < high)) continue;
    const Segment from = above_in_column(low, c, darkening_), to = above_in_column(high, c, darkening_);
    cosine += column.weight * (here * (from.light - to.light) + along * (from.moment - to.moment));
  }
  return {s.light, cosine};
}

std::uint32_t DiscLight::alone(const SurfacePoints& points, Shading& shading, DiscLanes& out, float* lit) const {
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
  alignas(64) std::int32_t how[kPacket];
  HWY_DYNAMIC_DISPATCH(LookAt)(points, top, out, how);
  std::uint32_t some = 0;
  out.facing_all = 0;
  for (int i = 0; i < kPacket; ++i) out.facing_all |= how[i] == kWhole ? 1U << i : 0U;
  for (int i = 0; i < kPacket; ++i) {
    lit[i] = points.hit[i] && how[i] == kWhole ? 1.F : 0.F;
    some |= lit[i] > 0 ? 1U << i : 0U;
    if (!points.hit[i] || how[i] != kSome) continue;
    const DiscShare share = alone(plane(points.facet_normal(i)), plane(shading.normal(i)));
    if (!(share.share > 0 && share.cosine > 0)) continue;
    lit[i] = static_cast<float>(share.share);
    shading.incident[i] = share.cosine / share.share;
    some |= 1U << i;
  }
  return some;
}

void DiscLight::left(const float (*horizons)[kPacket], const DiscLanes& turned, float* of_share,
                     float* of_cosine) const {
  const auto left_of =
      turned.facing_all == kAllLanes ? HWY_DYNAMIC_DISPATCH(LeftOfWhole) : HWY_DYNAMIC_DISPATCH(LeftOf);
  left_of(table_, columns_.data(), horizons, turned, of_share, of_cosine);
}

DiscShare DiscLight::ratio(const Free& open, const Free& faced, const DiscLanes& turned, std::uint32_t lane) const {
  const DiscPlane shading = turned.shading.lane(lane);
  double all = 0, left = 0;
  for (std::size_t k = 0; k < kDirections; ++k) {
    if (!faced[k]) continue;
    const double cosine = std::max(0.0, shading.at(places_[k].across, places_[k].upward));
    all += cosine;
    if (open[k]) left += cosine;
  }
  const double share = static_cast<double>(open.count()) / static_cast<double>(faced.count());
  // Of a normal that faces less of the disc than is between places, nothing is known.
  return {share, all > 0 ? left / all : share};
}

DiscShare DiscLight::left_of(const Free& free, const float* horizons, std::size_t stride, const DiscLanes& turned,
                             std::uint32_t lane) const {
  Free open;
  for (std::size_t k = 0; k < kDirections; ++k) {
    if (!free[k]) continue;
    // Between columns a horizon is straight; beyond the last it is as there.
    const auto x = static_cast<float>(places_[k].across);
    std::size_t j = 0;
    while (j + 2 < kColumns && columns_[j + 1] < x) ++j;
    const float t = std::clamp((x - columns_[j]) / (columns_[j + 1] - columns_[j]), 0.F, 1.F);
    const float low = std::max(horizons[j * stride], -2.F);
    const float high = std::max(horizons[(j + 1) * stride], -2.F);
    open.set(k, places_[k].upward > static_cast<double>(low + t * (high - low)));
  }
  return open.any() ? ratio(open, free, turned, lane) : DiscShare{};
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
