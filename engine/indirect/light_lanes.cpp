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

using PostVector = hn::CappedTag<float, kPacket>;     // as many values of a post as fit in a vector
using SectorVector = hn::CappedTag<float, kSectors>;  // one value of as many sectors as fit in a vector

// The four posts around a position, with their weights.
struct WeightedPosts {
  const LightPost *south, *north;  // the western posts; the eastern ones follow them in memory
  float south_west, south_east, north_west, north_east;
};

// Returns the weights drawn at BetweenPosts. `post`: the south-western one.
HWY_INLINE WeightedPosts WeightsAt(const LightPost* post, float east, float north) {
  const float north_east = east * north;
  return {post,      post + FieldPlane::kTileSide, 1 - east - north + north_east, east - north_east, north - north_east,
          north_east};
}

// Interpolates all values of a post: a LightPost is read as one array of floats, from its member x on.
HWY_INLINE void Interpolate(const WeightedPosts& posts, LightPost& out) {
  const PostVector d;
  const float *south = posts.south->x, *north = posts.north->x;
  constexpr std::size_t kValues = sizeof(LightPost) / sizeof(float);
  const auto weighted = [&](float share, const float* values) {
    return hn::Mul(hn::Set(d, share), hn::Load(d, values));
  };
  for (std::size_t k = 0; k < kValues; k += hn::Lanes(d)) {
    const auto in_south =
        hn::Add(weighted(posts.south_west, south + k), weighted(posts.south_east, south + kValues + k));
    const auto in_north =
        hn::Add(weighted(posts.north_west, north + k), weighted(posts.north_east, north + kValues + k));
    hn::Store(hn::Add(in_south, in_north), d, out.x + k);
  }
}

// Returns the irradiance of a surface with this unit normal (MOON_ME) from all sectors that it faces.
HWY_INLINE float FacingLight(const LightPost& light, float nx, float ny, float nz) {
  const SectorVector d;
  alignas(32) float arrives[kSectors];
  for (std::size_t k = 0; k < kSectors; k += hn::Lanes(d)) {
    const auto times = [&](float n, const float* values) { return hn::Mul(hn::Set(d, n), hn::Load(d, values + k)); };
    const auto dot = hn::Add(hn::Add(times(nx, light.x), times(ny, light.y)), times(nz, light.z));
    hn::Store(hn::Max(dot, hn::Zero(d)), d, arrives + k);
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
// Splits a coordinate, in posts from the field's south or west; beyond the field it is clamped to the border. Written
// with conditional expressions instead of std::min() and std::clamp(), which would keep loops from vectorising.
SELENOGRAPH_LANE SplitCoordinate Split(double posts, int tiles) {
  constexpr int kQuads = FieldPlane::kTileQuads;
  const double last = tiles * kQuads, not_below = posts > 0 ? posts : 0, inside = not_below < last ? not_below : last;
  const int quotient = static_cast<int>(inside * (1.0 / kQuads)), tile = quotient < tiles - 1 ? quotient : tiles - 1;
  // The product with 1 / 15 may be rounded up to the next tile: its remainder is then negative.
  const double remainder = inside - tile * kQuads, in_tile = remainder > 0 ? remainder : 0;
  const int quad = static_cast<int>(in_tile), post = quad < kQuads - 1 ? quad : kQuads - 1;
  return {tile, post, static_cast<float>(in_tile - post)};
}

// Implements set_field_lanes(). `posts`: FieldPlane::posts(), the matrix row by row; `middle`: FieldPlane::middle().
void SetFieldLanes(const double* posts, double middle, int tiles, const SurfacePoints& points, FieldLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = points.x[i], y = points.y[i], z = points.z[i];
    const double east = posts[0] * x + posts[1] * y + posts[2] * z, north = posts[3] * x + posts[4] * y + posts[5] * z,
                 inverse_up = 1 / (posts[6] * x + posts[7] * y + posts[8] * z);
    const SplitCoordinate column = Split(east * inverse_up + middle, tiles),
                          row = Split(north * inverse_up + middle, tiles);
    out.tile[i] = row.tile * tiles + column.tile;
    out.post[i] = row.post * FieldPlane::kTileSide + column.post;
    out.east[i] = column.share;
    out.north[i] = row.share;
  }
}

// Prefetches the four posts around each lane before the first is read. A post has two cache lines: they begin at x and
// at z.
HWY_INLINE void PrefetchPosts(const LightPost* posts, const FieldLanes& positions, std::uint32_t lanes) {
  for (int previous = -1; lanes; lanes &= lanes - 1) {
    const int south_west = positions.post[std::countr_zero(lanes)];
    if (south_west == previous) continue;
    previous = south_west;
    for (const LightPost* west : {posts + south_west, posts + south_west + FieldPlane::kTileSide})
      for (const LightPost* post : {west, west + 1}) {
        hwy::Prefetch(post->x);
        hwy::Prefetch(post->z);
      }
  }
}

// Implements read_posts().
void ReadPosts(const LightPost* posts, const float* factors, const FieldLanes& positions, std::uint32_t lanes,
               const Shading& shading, TerrainLanes& out) {
  PrefetchPosts(posts, positions, lanes);
  LightPost light;
  for (; lanes; lanes &= lanes - 1) {
    const int i = std::countr_zero(lanes), post = positions.post[i];
    const WeightedPosts around = WeightsAt(posts + post, positions.east[i], positions.north[i]);
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

// Implements light_from_terrain(). The single direction is that of the mean vector toward the sources; its mu0 is the
// irradiance over the fluence, and its cosine of phase that between the mean vector and the direction to the viewer.
void FromTerrain(const TerrainLanes& lanes, const Rays& rays, double sun_w_m2, DiffuseLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const float fluence = lanes.fluence[i], arrives = lanes.arrives[i];
    const auto dx = static_cast<float>(rays.dx[i]), dy = static_cast<float>(rays.dy[i]),
               dz = static_cast<float>(rays.dz[i]);
    const float toward_viewer = -(dx * lanes.x[i] + dy * lanes.y[i] + dz * lanes.z[i]);
    const float ray_square = dx * dx + dy * dy + dz * dz;
    const bool lit = (fluence > 0) & (arrives > 0);
    const float mean_cosine = arrives / fluence, phase_cosine = toward_viewer / (std::sqrt(ray_square) * fluence);
    const float mu0 = lit ? (mean_cosine < 1 ? mean_cosine : 1) : 1e-9F, cos_phase = lit ? phase_cosine : 0,
                light = lit ? fluence * lanes.factor[i] : 0;
    out.mu0[i] = static_cast<double>(mu0);
    out.cos_phase[i] = static_cast<double>(cos_phase);
    out.light[i] = sun_w_m2 * static_cast<double>(light);
  }
}

// Implements light_from_earth().
void FromEarth(const TerrainLanes& lanes, const SurfacePoints& points, const Shading& shading, const Rays& rays,
               const LightSources& sources, DiffuseLanes& out) {
  const double x = sources.earth.x(), y = sources.earth.y(), z = sources.earth.z(), earth_w_m2 = sources.earth_w_m2;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double incidence_cosine = shading.nx[i] * x + shading.ny[i] * y + shading.nz[i] * z;
    const double toward_viewer = -(rays.dx[i] * x + rays.dy[i] * y + rays.dz[i] * z);
    const double ray_length = std::sqrt(rays.dx[i] * rays.dx[i] + rays.dy[i] * rays.dy[i] + rays.dz[i] * rays.dz[i]);
    const bool lit = points.hit[i] & (lanes.earth[i] > 0) & (incidence_cosine > 0);
    out.mu0[i] = lit ? incidence_cosine : 1e-9;
    out.cos_phase[i] = lit ? toward_viewer / ray_length : 0;
    out.light[i] = lit ? earth_w_m2 * static_cast<double>(lanes.earth[i]) : 0;
  }
}

// Implements add_reflected().
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
