#include "engine/indirect/light_lanes.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <numeric>

#include "dem/support/vector_targets.h"
#include "engine/support/lane_math.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/light_lanes.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

using OfPost = hn::CappedTag<float, kSectors>;
inline constexpr int kStep = static_cast<int>(HWY_MIN(HWY_LANES(float), kSectors));

// Values between four posts, each of `kValues`: southwest + east a + north b + east north c.
template <int kValues>
class Quad {
 public:
  HWY_INLINE Quad() {}  // NOLINT(modernize-use-equals-default): compiled for the target
  HWY_INLINE void set(const float* south) {
    const float* north = south + FieldPlane::kTileSide * kValues;
    const OfPost d;
    for (int k = 0; k < kValues; k += kStep) {
      const auto sw = hn::Load(d, south + k), se = hn::Load(d, south + kValues + k);
      const auto nw = hn::Load(d, north + k), ne = hn::Load(d, north + kValues + k);
      const auto along = hn::Sub(se, sw);
      hn::Store(sw, d, at_ + k), hn::Store(along, d, east_ + k), hn::Store(hn::Sub(nw, sw), d, north_ + k);
      hn::Store(hn::Sub(hn::Sub(ne, nw), along), d, both_ + k);
    }
  }
  HWY_INLINE hn::Vec<OfPost> at(int value, hn::Vec<OfPost> east, hn::Vec<OfPost> north) const {
    const OfPost d;
    const auto a = hn::Load(d, at_ + value), b = hn::Load(d, east_ + value), c = hn::Load(d, north_ + value);
    const auto south = hn::Add(a, hn::Mul(east, b)), slope = hn::Add(c, hn::Mul(east, hn::Load(d, both_ + value)));
    return hn::Add(south, hn::Mul(north, slope));
  }

 private:
  alignas(64) float at_[kValues], east_[kValues], north_[kValues], both_[kValues];
};
using SectorQuad = Quad<3 * kSectors>;
using SumQuad = Quad<kSectors>;

// What each sector sends to a surface.
HWY_INLINE void Arriving(const SectorQuad& quad, float east, float north, float nx, float ny, float nz, float* out) {
  const OfPost d;
  const auto e = hn::Set(d, east), n = hn::Set(d, north);
  for (int k = 0; k < kSectors; k += kStep) {
    const auto x = quad.at(k, e, n), y = quad.at(kSectors + k, e, n), z = quad.at(2 * kSectors + k, e, n);
    const auto faces =
        hn::Add(hn::Add(hn::Mul(hn::Set(d, nx), x), hn::Mul(hn::Set(d, ny), y)), hn::Mul(hn::Set(d, nz), z));
    hn::Store(hn::Max(faces, hn::Zero(d)), d, out + k);
  }
}

HWY_INLINE void SumBetween(const SumQuad& quad, float east, float north, float* out) {
  const OfPost d;
  for (int k = 0; k < kSectors; k += kStep) hn::Store(quad.at(k, hn::Set(d, east), hn::Set(d, north)), d, out + k);
}

void SumOf(const LightPlace& place, float* out) {
  SumQuad quad;
  quad.set(&place.sum->x);
  SumBetween(quad, place.east, place.north, out);
}

void ArrivesAt(const LightPlace& place, float nx, float ny, float nz, float* out) {
  SectorQuad quad;
  quad.set(place.sectors->x);
  Arriving(quad, place.east, place.north, nx, ny, nz, out);
}

// A coordinate in posts as the tile, the post in it, and the way beyond.
struct AlongSide {
  int tile, post;
  float beyond;
};
SELENOGRAPH_LANE AlongSide Split(double posts, int tiles) {
  constexpr int kQuads = FieldPlane::kTileQuads;
  const double last = tiles * kQuads, least = posts > 0 ? posts : 0, inside = least < last ? least : last;
  const int at = static_cast<int>(inside * (1.0 / kQuads)), tile = at < tiles - 1 ? at : tiles - 1;
  const double within = inside - tile * kQuads, from = within > 0 ? within : 0;
  const int whole = static_cast<int>(from), post = whole < kQuads - 1 ? whole : kQuads - 1;
  return {tile, post, static_cast<float>(from - post)};
}

void InField(const double* posts, double middle, int tiles, const SurfacePoints& points, FieldLanes& out) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double x = points.x[i], y = points.y[i], z = points.z[i];
    const double across = posts[0] * x + posts[1] * y + posts[2] * z,
                 along = posts[3] * x + posts[4] * y + posts[5] * z,
                 up = 1 / (posts[6] * x + posts[7] * y + posts[8] * z);
    const AlongSide column = Split(across * up + middle, tiles), row = Split(along * up + middle, tiles);
    out.tile[i] = row.tile * tiles + column.tile, out.post[i] = row.post * FieldPlane::kTileSide + column.post;
    out.east[i] = column.beyond, out.north[i] = row.beyond;
  }
}

// Asks for the posts of all lanes before the first of them is waited for.
HWY_INLINE void Fetch(const SectorPost* sectors, const SumPost* sums, const FieldLanes& at, std::uint32_t lanes) {
  for (int of = -1; lanes; lanes &= lanes - 1) {
    const int post = at.post[std::countr_zero(lanes)];
    if (post == of) continue;
    of = post;
    for (const int row : {0, FieldPlane::kTileSide}) {
      const SectorPost* west = sectors + post + row;
      hwy::Prefetch(west), hwy::Prefetch(west->z), hwy::Prefetch(west[1].y), hwy::Prefetch(sums + post + row);
    }
  }
}

void ReadPosts(const SectorPost* sectors, const SumPost* sums, const FieldLanes& at, std::uint32_t lanes,
               const Shading& shading, TerrainLanes& out) {
  // Sums are of four at a time: halves of wider vectors are far apart.
  const hn::CappedTag<float, 4> four;
  constexpr int kFour = static_cast<int>(HWY_MIN(HWY_LANES(float), 4));
  Fetch(sectors, sums, at, lanes);
  SectorQuad sector_quad;
  SumQuad sum_quad;
  int of = at.post[std::countr_zero(lanes)];
  sector_quad.set(sectors[of].x), sum_quad.set(&sums[of].x);
  for (; lanes; lanes &= lanes - 1) {
    const int i = std::countr_zero(lanes);
    // Neighbours are mostly between the same four.
    if (at.post[i] != of) of = at.post[i], sector_quad.set(sectors[of].x), sum_quad.set(&sums[of].x);
    alignas(32) float arrives[kSectors], sum[kSectors];
    Arriving(sector_quad, at.east[i], at.north[i], static_cast<float>(shading.nx[i]), static_cast<float>(shading.ny[i]),
             static_cast<float>(shading.nz[i]), arrives);
    SumBetween(sum_quad, at.east[i], at.north[i], sum);
    auto all = hn::Load(four, arrives);
    for (int k = kFour; k < kSectors; k += kFour) all = hn::Add(all, hn::Load(four, arrives + k));
    out.arrives[i] = hn::GetLane(hn::SumOfLanes(four, all));
    out.x[i] = sum[0], out.y[i] = sum[1], out.z[i] = sum[2], out.fluence[i] = sum[3], out.factor[i] = sum[4];
    out.earth[i] = sum[5];
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
    out.mu0[i] = static_cast<double>(mu0), out.cos_phase[i] = static_cast<double>(cos_phase);
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
    out.mu0[i] = lit ? along : 1e-9, out.cos_phase[i] = lit ? back / length : 0;
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

HWY_EXPORT(SumOf);
HWY_EXPORT(ArrivesAt);
HWY_EXPORT(InField);
HWY_EXPORT(ReadPosts);
HWY_EXPORT(FromTerrain);
HWY_EXPORT(FromEarth);
HWY_EXPORT(AddReflected);

SumPost sum_between(const LightPlace& place) {
  SumPost out;
  HWY_DYNAMIC_DISPATCH(SumOf)(place, &out.x);
  return out;
}

Irradiance irradiance_at(const LightPlace& place, const Vec3& normal, const LightSources& sources) {
  alignas(32) float arrives[kSectors];
  HWY_DYNAMIC_DISPATCH(ArrivesAt)
  (place, static_cast<float>(normal.x()), static_cast<float>(normal.y()), static_cast<float>(normal.z()), arrives);
  const float terrain = std::accumulate(std::begin(arrives), std::end(arrives), 0.F);
  return {
      0, sources.sun_w_m2 * static_cast<double>(terrain),
      sources.earth_w_m2 * static_cast<double>(sum_between(place).earth) * std::max(normal.dot(sources.earth), 0.0)};
}

void places_in_field(const FieldPlane& plane, const SurfacePoints& points, FieldLanes& out) {
  HWY_DYNAMIC_DISPATCH(InField)(plane.posts(), plane.middle(), plane.tiles(), points, out);
}

void read_posts(const SectorPost* sectors, const SumPost* sums, const FieldLanes& at, std::uint32_t lanes,
                const Shading& shading, TerrainLanes& out) {
  HWY_DYNAMIC_DISPATCH(ReadPosts)(sectors, sums, at, lanes, shading, out);
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
