#include "engine/indirect/light_lanes.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "dem/base/vector_targets.h"
#include "engine/indirect/sector_sum.h"
#include "engine/support/lane_math.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/light_lanes.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using Wide = hn::CappedTag<float, kPacket>;
using OfSectors = hn::CappedTag<float, kSectors>;

// The four posts around a position, with their weights.
struct WeightedPosts {
  const LightPost *south, *north;  // the western posts; the eastern ones follow them in memory
  float south_west, south_east, north_west, north_east;
};

HWY_INLINE WeightedPosts WeightsAt(const LightPost* post, float east, float north) {
  const float both = east * north;
  return {post, post + FieldPlane::kTileSide, 1 - east - north + both, east - both, north - both, both};
}

// Interpolates all values of a post.
HWY_INLINE void Interpolate(const WeightedPosts& at, LightPost& out) {
  const Wide d;
  const float *south = at.south->x, *north = at.north->x;
  constexpr std::size_t kValues = sizeof(LightPost) / sizeof(float);
  const auto weighted = [&](float share, const float* values) {
    return hn::Mul(hn::Set(d, share), hn::Load(d, values));
  };
  for (std::size_t k = 0; k < kValues; k += hn::Lanes(d)) {
    const auto in_south = hn::Add(weighted(at.south_west, south + k), weighted(at.south_east, south + kValues + k)),
               in_north = hn::Add(weighted(at.north_west, north + k), weighted(at.north_east, north + kValues + k));
    hn::Store(hn::Add(in_south, in_north), d, out.x + k);
  }
}

// Returns the irradiance of a surface from all sectors that it faces.
HWY_INLINE float FacingLight(const LightPost& light, float nx, float ny, float nz) {
  const OfSectors d;
  alignas(32) float arrives[kSectors];
  for (std::size_t k = 0; k < kSectors; k += hn::Lanes(d)) {
    const auto times = [&](float n, const float* values) { return hn::Mul(hn::Set(d, n), hn::Load(d, values + k)); };
    const auto faces = hn::Add(hn::Add(times(nx, light.x), times(ny, light.y)), times(nz, light.z));
    hn::Store(hn::Max(faces, hn::Zero(d)), d, arrives + k);
  }
  return sum_of_sectors(arrives);
}

void InterpolateAt(const BetweenPosts& position, LightPost& out) {
  Interpolate(WeightsAt(position.post, position.east, position.north), out);
}

void ArrivesAt(const LightPost& light, const Vec3& normal, float& out) {
  out = FacingLight(light, static_cast<float>(normal.x()), static_cast<float>(normal.y()),
                    static_cast<float>(normal.z()));
}

// A coordinate in posts, split into the tile, the post in it, and the share of the way to the next post.
struct SplitCoordinate {
  int tile, post;
  float share;
};
SELENOGRAPH_LANE SplitCoordinate Split(double posts, int tiles) {
  constexpr int kQuads = FieldPlane::kTileQuads;
  const double last = tiles * kQuads, not_below = posts > 0 ? posts : 0, inside = not_below < last ? not_below : last;
  const int quotient = static_cast<int>(inside * (1.0 / kQuads)), tile = quotient < tiles - 1 ? quotient : tiles - 1;
  const double remainder = inside - tile * kQuads, in_tile = remainder > 0 ? remainder : 0;
  const int nearest = static_cast<int>(in_tile), post = nearest < kQuads - 1 ? nearest : kQuads - 1;
  return {tile, post, static_cast<float>(in_tile - post)};
}

void SetFieldLanes(const double* posts, double middle, int tiles, const SurfacePoints& points, FieldLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = points.x[i], y = points.y[i], z = points.z[i];
    const double across = posts[0] * x + posts[1] * y + posts[2] * z,
                 along = posts[3] * x + posts[4] * y + posts[5] * z,
                 up = 1 / (posts[6] * x + posts[7] * y + posts[8] * z);
    const SplitCoordinate column = Split(across * up + middle, tiles), row = Split(along * up + middle, tiles);
    out.tile[i] = row.tile * tiles + column.tile;
    out.post[i] = row.post * FieldPlane::kTileSide + column.post;
    out.east[i] = column.share;
    out.north[i] = row.share;
  }
}

// Prefetches the posts of all lanes before the first is read.
HWY_INLINE void Fetch(const LightPost* posts, const FieldLanes& at, std::uint32_t lanes) {
  for (int previous = -1; lanes; lanes &= lanes - 1) {
    const int post = at.post[std::countr_zero(lanes)];
    if (post == previous) continue;
    previous = post;
    for (const LightPost* west : {posts + post, posts + post + FieldPlane::kTileSide})
      for (const LightPost* to : {west, west + 1}) {
        hwy::Prefetch(to->x);
        hwy::Prefetch(to->z);
      }
  }
}

void ReadPosts(const LightPost* posts, const float* factors, const FieldLanes& at, std::uint32_t lanes,
               const Shading& shading, TerrainLanes& out) {
  Fetch(posts, at, lanes);
  LightPost light;
  for (; lanes; lanes &= lanes - 1) {
    const int i = std::countr_zero(lanes), post = at.post[i];
    const WeightedPosts around = WeightsAt(posts + post, at.east[i], at.north[i]);
    Interpolate(around, light);
    out.arrives[i] = FacingLight(light, static_cast<float>(shading.nx[i]), static_cast<float>(shading.ny[i]),
                                 static_cast<float>(shading.nz[i]));
    out.x[i] = light.sum.x;
    out.y[i] = light.sum.y;
    out.z[i] = light.sum.z;
    out.fluence[i] = light.sum.fluence;
    out.earth[i] = light.sum.earth;
    const float *south = factors + post, *north = south + FieldPlane::kTileSide;
    out.factor[i] = around.south_west * south[0] + around.south_east * south[1] + around.north_west * north[0] +
                    around.north_east * north[1];
  }
}

void FromTerrain(const TerrainLanes& lanes, const Rays& rays, double sun_w_m2, DiffuseLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float fluence = lanes.fluence[i], arrives = lanes.arrives[i];
    const auto dx = static_cast<float>(rays.dx[i]), dy = static_cast<float>(rays.dy[i]),
               dz = static_cast<float>(rays.dz[i]);
    const float back = -(dx * lanes.x[i] + dy * lanes.y[i] + dz * lanes.z[i]), square = dx * dx + dy * dy + dz * dz;
    const bool lit = (fluence > 0) & (arrives > 0);
    const float share = arrives / fluence, cosine = back / (std::sqrt(square) * fluence);
    const float mu0 = lit ? (share < 1 ? share : 1) : 1e-9F, cos_phase = lit ? cosine : 0,
                light = lit ? fluence * lanes.factor[i] : 0;
    out.mu0[i] = static_cast<double>(mu0);
    out.cos_phase[i] = static_cast<double>(cos_phase);
    out.light[i] = sun_w_m2 * static_cast<double>(light);
  }
}

void FromEarth(const TerrainLanes& lanes, const SurfacePoints& points, const Shading& shading, const Rays& rays,
               const LightSources& sources, DiffuseLanes& out) {
  const double x = sources.earth.x(), y = sources.earth.y(), z = sources.earth.z(), shines = sources.earth_w_m2;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double along = shading.nx[i] * x + shading.ny[i] * y + shading.nz[i] * z;
    const double back = -(rays.dx[i] * x + rays.dy[i] * y + rays.dz[i] * z);
    const double length = std::sqrt(rays.dx[i] * rays.dx[i] + rays.dy[i] * rays.dy[i] + rays.dz[i] * rays.dz[i]);
    const bool lit = points.hit[i] & (lanes.earth[i] > 0) & (along > 0);
    out.mu0[i] = lit ? along : 1e-9;
    out.cos_phase[i] = lit ? back / length : 0;
    out.light[i] = lit ? shines * static_cast<double>(lanes.earth[i]) : 0;
  }
}

void AddReflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double value = lanes.light[i] * reflected[i] * (albedo ? albedo[i] : 1);
    radiance[i] += lanes.light[i] > 0 ? static_cast<float>(value) : 0;
  }
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(InterpolateAt);
HWY_EXPORT(ArrivesAt);
HWY_EXPORT(SetFieldLanes);
HWY_EXPORT(ReadPosts);
HWY_EXPORT(FromTerrain);
HWY_EXPORT(FromEarth);
HWY_EXPORT(AddReflected);

LightSum sum_between(const BetweenPosts& position) {
  LightPost light;
  HWY_DYNAMIC_DISPATCH(InterpolateAt)(position, light);
  return light.sum;
}

Irradiance irradiance_at(const BetweenPosts& position, const Vec3& normal, const LightSources& sources) {
  LightPost light;
  float terrain;
  HWY_DYNAMIC_DISPATCH(InterpolateAt)(position, light);
  HWY_DYNAMIC_DISPATCH(ArrivesAt)(light, normal, terrain);
  return {0, sources.sun_w_m2 * static_cast<double>(terrain),
          sources.earth_w_m2 * static_cast<double>(light.sum.earth) * std::max(normal.dot(sources.earth), 0.0)};
}

Irradiance irradiance_on_level(const Vec3& place_m, const Vec3& normal, const LightSources& sources) {
  return {0, 0, sources.earth_w_m2 * sources.earth_above_level(place_m) * std::max(normal.dot(sources.earth), 0.0)};
}

void set_field_lanes(const FieldPlane& plane, const SurfacePoints& points, FieldLanes& out) {
  HWY_DYNAMIC_DISPATCH(SetFieldLanes)(plane.posts(), plane.middle(), plane.tiles(), points, out);
}

void read_posts(const LightPost* posts, const float* factors, const FieldLanes& at, std::uint32_t lanes,
                const Shading& shading, TerrainLanes& out) {
  HWY_DYNAMIC_DISPATCH(ReadPosts)(posts, factors, at, lanes, shading, out);
}

void light_from_terrain(const TerrainLanes& lanes, const Rays& rays, double sun_w_m2, DiffuseLanes& out) {
  HWY_DYNAMIC_DISPATCH(FromTerrain)(lanes, rays, sun_w_m2, out);
}

void light_from_earth(const TerrainLanes& lanes, const SurfacePoints& points, const Shading& shading, const Rays& rays,
                      const LightSources& sources, DiffuseLanes& out) {
  HWY_DYNAMIC_DISPATCH(FromEarth)(lanes, points, shading, rays, sources, out);
}

void add_reflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance) {
  HWY_DYNAMIC_DISPATCH(AddReflected)(lanes, reflected, albedo, radiance);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
