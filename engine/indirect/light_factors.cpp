#include "engine/indirect/light_factors.h"

#include <algorithm>
#include <cmath>

#include "dem/base/vector_targets.h"
#include "engine/indirect/sector_sum.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/indirect/light_factors.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_VIEW_LANES
#define SELENOGRAPH_ENGINE_VIEW_LANES
namespace selenograph::engine {

static_assert(FieldPlane::kTileSide == kPacket && 2 * kSectors == kPacket);

// Unit vectors from a row of posts to the viewer.
struct alignas(64) ViewLanes {
  float x[kPacket], y[kPacket], z[kPacket];
};

// Positions from which the posts of a row are viewed; MOON_ME, m.
struct alignas(64) EyeLanes {
  double x[kPacket], y[kPacket], z[kPacket];
};

// Light at two posts by sector: eight lanes for each post. The fluence is 0 in sectors whose light does not reach the
// ground.
struct alignas(64) SectorLanes {
  double mu0[kPacket], mu[kPacket], cos_phase[kPacket], reflected[kPacket];
  float fluence[kPacket];
};

// The same light at a row of posts, taken as from one direction.
struct alignas(64) SingleDirection {
  double mu0[kPacket], mu[kPacket], cos_phase[kPacket], reflected[kPacket];
  float exact[kPacket];  // fluence times reflectance, summed over the sectors
};

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Sets the directions from a row of posts to the viewer. `first`: position of the first post on the plane; `next`: step
// to the next post.
void ViewDirections(const Vec3& first, const Vec3& next, const EyeLanes& eye, const PostGround* ground,
                    ViewLanes& out) {
  const double x = first.x(), y = first.y(), z = first.z(), nx = next.x(), ny = next.y(), nz = next.z();
  double radius[kPacket];  // of the ground, m
  for (int i = 0; i < kPacket; ++i) radius[i] = kMoonRadius_m + static_cast<double>(ground[i].height_m);
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    // Move the post along its radius from the plane to the ground.
    const double px = x + i * nx, py = y + i * ny, pz = z + i * nz;
    const double scale = radius[i] / std::sqrt(px * px + py * py + pz * pz);
    const double dx = eye.x[i] - px * scale, dy = eye.y[i] - py * scale, dz = eye.z[i] - pz * scale,
                 inverse = 1 / std::sqrt(dx * dx + dy * dy + dz * dz);
    out.x[i] = static_cast<float>(dx * inverse);
    out.y[i] = static_cast<float>(dy * inverse);
    out.z[i] = static_cast<float>(dz * inverse);
  }
}

// Writes the sectors of post `i` of a row into eight lanes from `lane` on.
void SetSectors(const LightPost& post, const Vec3f& normal, const ViewLanes& to_viewer, int i, int lane,
                SectorLanes& out) {
  const float *x = post.x, *y = post.y, *z = post.z;
  const float nx = normal.x(), ny = normal.y(), nz = normal.z(), lx = to_viewer.x[i], ly = to_viewer.y[i],
              lz = to_viewer.z[i];
  const float cos_emission = nx * lx + ny * ly + nz * lz;
  // A post's own facet may face away from the viewer while pixels around it do not: it counts as seen obliquely.
  const double mu = static_cast<double>(cos_emission > 0.05F ? cos_emission : 0.05F);
  SELENOGRAPH_INDEPENDENT_LANES
  for (int k = 0; k < kSectors; ++k) {
    const float length = std::sqrt(x[k] * x[k] + y[k] * y[k] + z[k] * z[k]);
    const float along_normal = nx * x[k] + ny * y[k] + nz * z[k], toward_viewer = lx * x[k] + ly * y[k] + lz * z[k];
    const bool faces = (length > 0) & (along_normal > 1e-9F * length);
    const float inverse = 1 / length;
    const float mu0 = faces ? along_normal * inverse : 1e-9F, cos_phase = faces ? toward_viewer * inverse : 0;
    out.mu0[lane + k] = static_cast<double>(mu0);
    out.mu[lane + k] = mu;
    out.cos_phase[lane + k] = static_cast<double>(cos_phase);
    out.fluence[lane + k] = faces ? length : 0;
  }
}

// Sums the reflected light of the sectors of post `i`, which are the eight lanes from `lane` on, and sets the geometry
// of the single direction that stands for them.
void SumSectors(const SectorLanes& lanes, int lane, const LightSum& post, const ViewLanes& to_viewer, int i,
                SingleDirection& out) {
  alignas(32) float exact[kSectors];
  alignas(32) float arrives[kSectors];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int k = 0; k < kSectors; ++k) {
    exact[k] = lanes.fluence[lane + k] * static_cast<float>(lanes.reflected[lane + k]);
    arrives[k] = lanes.fluence[lane + k] * static_cast<float>(lanes.mu0[lane + k]);
  }
  const float irradiance = sum_of_sectors(arrives), fluence = post.fluence;
  const float toward_viewer = post.x * to_viewer.x[i] + post.y * to_viewer.y[i] + post.z * to_viewer.z[i];
  out.exact[i] = sum_of_sectors(exact);
  out.mu[i] = lanes.mu[lane];
  out.mu0[i] = static_cast<double>(irradiance > 0 ? irradiance / fluence : 1e-9F);
  out.cos_phase[i] = static_cast<double>(fluence > 0 ? toward_viewer / fluence : 0);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(ViewDirections);
HWY_EXPORT(SetSectors);
HWY_EXPORT(SumSectors);

namespace {

// Sets the viewer's position for each post of a row. `position_m(i)`: position of post i on the plane.
template <typename Position>
void set_eyes(const Viewer& viewer, const PostGround* ground, const Position& position_m, EyeLanes& out) {
  // A viewer that does not vary is the same for all ground, so any position will do.
  Vec3 eye = viewer.varies() ? Vec3::zero() : viewer.eye_for(Vec3::zero());
  for (int i = 0; i < kPacket; ++i) {
    // A post without data has no position on the ground; it takes the eye of the post before.
    if (viewer.varies() && !std::isnan(ground[i].height_m))
      eye = viewer.eye_for(position_m(i).normalized() * (kMoonRadius_m + static_cast<double>(ground[i].height_m)));
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
  ViewLanes to_viewer;
  SectorLanes pair;
  SingleDirection row;
  for (int r = 0; r < kPacket; ++r) {
    if (!rows.has(r)) continue;
    const auto first = static_cast<std::size_t>(r * kPacket);
    const Vec3 first_m = plane.position_m(west, south + r), next_m = plane.position_m(west + 1, south + r) - first_m;
    set_eyes(
        viewer, &light.ground[first], [&](int i) -> Vec3 { return first_m + i * next_m; }, eyes);
    HWY_DYNAMIC_DISPATCH(ViewDirections)(first_m, next_m, eyes, &light.ground[first], to_viewer);
    for (int i = 0; i < kPacket; i += 2) {
      const std::size_t post = first + static_cast<std::size_t>(i);
      HWY_DYNAMIC_DISPATCH(SetSectors)(light.posts[post], light.ground[post].normal, to_viewer, i, 0, pair);
      HWY_DYNAMIC_DISPATCH(SetSectors)
      (light.posts[post + 1], light.ground[post + 1].normal, to_viewer, i + 1, kSectors, pair);
      brdf.times_mu0(pair.mu0, pair.mu, pair.cos_phase, nullptr, pair.reflected);
      HWY_DYNAMIC_DISPATCH(SumSectors)(pair, 0, light.posts[post].sum, to_viewer, i, row);
      HWY_DYNAMIC_DISPATCH(SumSectors)(pair, kSectors, light.posts[post + 1].sum, to_viewer, i + 1, row);
    }
    brdf.times_mu0(row.mu0, row.mu, row.cos_phase, nullptr, row.reflected);
    for (int i = 0; i < kPacket; ++i) {
      const std::size_t post = first + static_cast<std::size_t>(i);
      // The limits keep nearly dark posts, whose quotient is arbitrary, from dominating the pixels around them.
      const float from_single_direction = light.posts[post].sum.fluence * static_cast<float>(row.reflected[i]);
      const bool lit = from_single_direction > 0 && row.exact[i] > 0;
      factors[post] = lit ? std::clamp(row.exact[i] / from_single_direction, 0.25F, 4.F) : 1;
    }
  }
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
