#include "engine/indirect/light_lanes.h"

#include <algorithm>
#include <cmath>

#include "dem/support/vector_targets.h"
#include "engine/support/lane_math.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/light_lanes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;

static_assert(sizeof(LightPost) == 4 * kSectors * sizeof(float));
using OfPost = hn::CappedTag<float, kSectors>;
inline constexpr int kStep = static_cast<int>(HWY_MIN(HWY_LANES(float), kSectors));

// Reads the values of posts between the four around a place.
class Reader {
 public:
  explicit Reader(const LightPlace& place)
      : south_(place.post->from[0]),
        north_(place.post[place.row].from[0]),
        east_(place.east),
        north_share_(place.north) {}
  HWY_INLINE hn::Vec<OfPost> at(int value) const {
    constexpr int kNext = 4 * kSectors;
    const OfPost d;
    const auto a = hn::Set(d, east_), b = hn::Set(d, north_share_);
    const auto sw = hn::LoadU(d, south_ + value), se = hn::LoadU(d, south_ + kNext + value);
    const auto nw = hn::LoadU(d, north_ + value), ne = hn::LoadU(d, north_ + kNext + value);
    const auto s = hn::Add(sw, hn::Mul(a, hn::Sub(se, sw))), n = hn::Add(nw, hn::Mul(a, hn::Sub(ne, nw)));
    return hn::Add(s, hn::Mul(b, hn::Sub(n, s)));
  }

 private:
  const float *south_, *north_;
  float east_, north_share_;
};

void Between(const LightPlace& place, float* out) {
  const Reader reader(place);
  for (int k = 0; k < 4 * kSectors; k += kStep) hn::StoreU(reader.at(k), OfPost(), out + k);
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

// Of each lane, from its posts: the irradiance, and what is the same for all normals.
struct alignas(64) TerrainLanes {
  float arrives[kPacket], x[kPacket], y[kPacket], z[kPacket], fluence[kPacket], factor[kPacket], earth[kPacket];
};

void ReadPosts(const LightPlace* places, const SurfacePoints& points, const Shading& shading, TerrainLanes& out) {
  const OfPost d;
  for (int i = 0; i < kPacket; ++i) {
    const Reader reader(places[i]);
    const auto nx = hn::Set(d, static_cast<float>(shading.nx[i])), ny = hn::Set(d, static_cast<float>(shading.ny[i])),
               nz = hn::Set(d, static_cast<float>(shading.nz[i]));
    auto sum = hn::Zero(d);
    alignas(32) float rest[kSectors];
    for (int k = 0; k < kSectors; k += kStep) {
      const auto x = reader.at(k), y = reader.at(kSectors + k), z = reader.at(2 * kSectors + k);
      const auto faces = hn::Add(hn::Add(hn::Mul(nx, x), hn::Mul(ny, y)), hn::Mul(nz, z));
      sum = hn::Add(sum, hn::Max(faces, hn::Zero(d)));
      hn::Store(reader.at(3 * kSectors + k), d, rest + k);
    }
    out.arrives[i] = points.hit[i] ? hn::GetLane(hn::SumOfLanes(d, sum)) : 0;
    out.x[i] = rest[0], out.y[i] = rest[1], out.z[i] = rest[2], out.fluence[i] = rest[3], out.factor[i] = rest[4];
    out.earth[i] = rest[5];
  }
}

void FromTerrain(const LightPlace* places, const SurfacePoints& points, const Shading& shading, const Rays& rays,
                 DiffuseLanes& out, float* earth) {
  TerrainLanes lanes;
  ReadPosts(places, points, shading, lanes);
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
    out.light[i] = static_cast<double>(light);
    earth[i] = lanes.earth[i];
  }
}

void FromEarth(const float* earth, const SurfacePoints& points, const Shading& shading, const Rays& rays,
               const Vec3& direction, DiffuseLanes& out) {
  const double x = direction.x(), y = direction.y(), z = direction.z();
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double along = shading.nx[i] * x + shading.ny[i] * y + shading.nz[i] * z;
    const double back = -(rays.dx[i] * x + rays.dy[i] * y + rays.dz[i] * z);
    const double length = std::sqrt(rays.dx[i] * rays.dx[i] + rays.dy[i] * rays.dy[i] + rays.dz[i] * rays.dz[i]);
    const bool lit = points.hit[i] & (earth[i] > 0) & (along > 0);
    out.mu0[i] = lit ? along : 1e-9, out.cos_phase[i] = lit ? back / length : 0;
    out.light[i] = lit ? static_cast<double>(earth[i]) : 0;
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

HWY_EXPORT(Between);
HWY_EXPORT(InField);
HWY_EXPORT(FromTerrain);
HWY_EXPORT(FromEarth);
HWY_EXPORT(AddReflected);

LightPost post_between(const LightPlace& place) {
  LightPost out;
  HWY_DYNAMIC_DISPATCH(Between)(place, out.from[0]);
  return out;
}

Irradiance irradiance_at(const LightPlace& place, const Vec3& normal, const Vec3& earth) {
  const LightPost post = post_between(place);
  double terrain = 0;
  for (std::size_t k = 0; k < kSectors; ++k)
    terrain +=
        std::max(normal.x() * static_cast<double>(post.from[0][k]) + normal.y() * static_cast<double>(post.from[1][k]) +
                     normal.z() * static_cast<double>(post.from[2][k]),
                 0.0);
  return {0, terrain, static_cast<double>(post.earth) * std::max(normal.dot(earth), 0.0)};
}

void places_in_field(const FieldPlane& plane, const SurfacePoints& points, FieldLanes& out) {
  HWY_DYNAMIC_DISPATCH(InField)(plane.posts(), plane.middle(), plane.tiles(), points, out);
}

void light_from_terrain(const LightPlace (&places)[kPacket], const SurfacePoints& points, const Shading& shading,
                        const Rays& rays, DiffuseLanes& out, float (&earth)[kPacket]) {
  HWY_DYNAMIC_DISPATCH(FromTerrain)(places, points, shading, rays, out, earth);
}

void light_from_earth(const float (&earth)[kPacket], const SurfacePoints& points, const Shading& shading,
                      const Rays& rays, const Vec3& direction, DiffuseLanes& out) {
  HWY_DYNAMIC_DISPATCH(FromEarth)(earth, points, shading, rays, direction, out);
}

void add_reflected(const DiffuseLanes& lanes, const double* reflected, const double* albedo, float* radiance) {
  HWY_DYNAMIC_DISPATCH(AddReflected)(lanes, reflected, albedo, radiance);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
