#include "engine/indirect/light_factors.h"

#include <algorithm>
#include <cmath>

#include "dem/base/vector_targets.h"
#include "engine/indirect/sector_sum.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/light_factors.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_LOOK_LANES
#define SELENOGRAPH_ENGINE_LOOK_LANES
namespace selenograph::engine {

static_assert(FieldPlane::kTileSide == kPacket && 2 * kSectors == kPacket);

// From a row of posts to the viewer: unit.
struct alignas(64) LookLanes {
  float x[kPacket], y[kPacket], z[kPacket];
};

// Where the viewer is when he looks at each post of a row; MOON_ME, m.
struct alignas(64) EyeLanes {
  double x[kPacket], y[kPacket], z[kPacket];
};

// Light of two posts, by sectors. Where light doesn't reach the ground its fluence is 0.
struct alignas(64) SectorLanes {
  double mu0[kPacket], mu[kPacket], cos_phase[kPacket], reflected[kPacket];
  float fluence[kPacket];
};

// As of one direction, of a row of posts.
struct alignas(64) OneDirection {
  double mu0[kPacket], mu[kPacket], cos_phase[kPacket], reflected[kPacket];
  float exact[kPacket];  // fluence times what all sectors reflect of it
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// `first`: of the plane, where the first post is; `next`: how far it is to the next.
void Look(const Vec3& first, const Vec3& next, const EyeLanes& eye, const PostGround* ground, LookLanes& out) {
  const double x = first.x(), y = first.y(), z = first.z(), nx = next.x(), ny = next.y(), nz = next.z();
  double radius[kPacket];
  for (int i = 0; i < kPacket; ++i) radius[i] = kMoonRadius_m + static_cast<double>(ground[i].height_m);
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double px = x + i * nx, py = y + i * ny, pz = z + i * nz;
    const double scale = radius[i] / std::sqrt(px * px + py * py + pz * pz);
    const double dx = eye.x[i] - px * scale, dy = eye.y[i] - py * scale, dz = eye.z[i] - pz * scale,
                 inverse = 1 / std::sqrt(dx * dx + dy * dy + dz * dz);
    out.x[i] = static_cast<float>(dx * inverse);
    out.y[i] = static_cast<float>(dy * inverse);
    out.z[i] = static_cast<float>(dz * inverse);
  }
}

// Of the post `i` of a row into eight lanes from `at` on.
void Sectors(const LightPost& post, const Eigen::Vector3f& normal, const LookLanes& look, int i, int at,
             SectorLanes& out) {
  const float *x = post.x, *y = post.y, *z = post.z;
  const float nx = normal.x(), ny = normal.y(), nz = normal.z(), lx = look.x[i], ly = look.y[i], lz = look.z[i];
  const float emission = nx * lx + ny * ly + nz * lz;
  const double mu = static_cast<double>(emission > 0.05F ? emission : 0.05F);
  SELENOGRAPH_INDEPENDENT_LANES
  for (int k = 0; k < kSectors; ++k) {
    const float length = std::sqrt(x[k] * x[k] + y[k] * y[k] + z[k] * z[k]);
    const float along = nx * x[k] + ny * y[k] + nz * z[k], back = lx * x[k] + ly * y[k] + lz * z[k];
    const bool faces = (length > 0) & (along > 1e-9F * length);
    const float inverse = 1 / length, mu0 = faces ? along * inverse : 1e-9F, cos_phase = faces ? back * inverse : 0;
    out.mu0[at + k] = static_cast<double>(mu0);
    out.mu[at + k] = mu;
    out.cos_phase[at + k] = static_cast<double>(cos_phase);
    out.fluence[at + k] = faces ? length : 0;
  }
}

void SumSectors(const SectorLanes& lanes, int at, const LightSum& post, const LookLanes& look, int i,
                OneDirection& out) {
  alignas(32) float exact[kSectors], arrives[kSectors];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int k = 0; k < kSectors; ++k) {
    exact[k] = lanes.fluence[at + k] * static_cast<float>(lanes.reflected[at + k]);
    arrives[k] = lanes.fluence[at + k] * static_cast<float>(lanes.mu0[at + k]);
  }
  const float sum = sum_of_sectors(arrives), fluence = post.fluence;
  const float back = post.x * look.x[i] + post.y * look.y[i] + post.z * look.z[i];
  out.exact[i] = sum_of_sectors(exact);
  out.mu[i] = lanes.mu[at];
  out.mu0[i] = static_cast<double>(sum > 0 ? sum / fluence : 1e-9F);
  out.cos_phase[i] = static_cast<double>(fluence > 0 ? back / fluence : 0);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(Look);
HWY_EXPORT(Sectors);
HWY_EXPORT(SumSectors);

namespace {

// `place(i)`: of a post.
template <typename Place>
void set_eyes(const Viewer& viewer, const PostGround* ground, const Place& place, EyeLanes& out) {
  Vec3 eye = viewer.varies() ? Vec3::Zero() : viewer.looking_at(Vec3::Zero());
  for (int i = 0; i < kPacket; ++i) {
    // Nobody looks at a post without data.
    if (viewer.varies() && !std::isnan(ground[i].height_m))
      eye = viewer.looking_at(place(i).normalized() * (kMoonRadius_m + static_cast<double>(ground[i].height_m)));
    out.x[i] = eye.x();
    out.y[i] = eye.y();
    out.z[i] = eye.z();
  }
}

}  // namespace

void set_factors(const LightTile& light, const FieldPlane& plane, const TileRows& rows, const Viewer& viewer,
                 const Brdf& brdf, std::span<float> factors) {
  const int south = rows.tile / plane.tiles() * FieldPlane::kTileQuads,
            west = rows.tile % plane.tiles() * FieldPlane::kTileQuads;
  EyeLanes eyes;
  LookLanes look;
  SectorLanes pair;
  OneDirection row;
  for (int r = 0; r < kPacket; ++r) {
    if (!rows.has(r)) continue;
    const auto first = static_cast<std::size_t>(r * kPacket);
    const Vec3 place = plane.at(west, south + r), next = plane.at(west + 1, south + r) - place;
    set_eyes(
        viewer, &light.ground[first], [&](int i) -> Vec3 { return place + i * next; }, eyes);
    HWY_DYNAMIC_DISPATCH(Look)(place, next, eyes, &light.ground[first], look);
    for (int i = 0; i < kPacket; i += 2) {
      const std::size_t post = first + static_cast<std::size_t>(i);
      HWY_DYNAMIC_DISPATCH(Sectors)(light.posts[post], light.ground[post].normal, look, i, 0, pair);
      HWY_DYNAMIC_DISPATCH(Sectors)
      (light.posts[post + 1], light.ground[post + 1].normal, look, i + 1, kSectors, pair);
      brdf.times_mu0(pair.mu0, pair.mu, pair.cos_phase, nullptr, pair.reflected);
      HWY_DYNAMIC_DISPATCH(SumSectors)(pair, 0, light.posts[post].sum, look, i, row);
      HWY_DYNAMIC_DISPATCH(SumSectors)(pair, kSectors, light.posts[post + 1].sum, look, i + 1, row);
    }
    brdf.times_mu0(row.mu0, row.mu, row.cos_phase, nullptr, row.reflected);
    for (int i = 0; i < kPacket; ++i) {
      const std::size_t post = first + static_cast<std::size_t>(i);
      const float simple = light.posts[post].sum.fluence * static_cast<float>(row.reflected[i]);
      const bool lit = simple > 0 && row.exact[i] > 0;
      factors[post] = lit ? std::clamp(row.exact[i] / simple, 0.25F, 4.F) : 1;
    }
  }
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
