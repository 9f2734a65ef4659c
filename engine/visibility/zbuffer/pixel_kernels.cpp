#include "engine/visibility/zbuffer/pixel_kernels.h"

#include <cstring>

#include "dem/base/vector_targets.h"
#include "engine/scene/raster_mesh.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/zbuffer/pixel_kernels.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Store full vectors only: a vector load from narrower pending stores waits until they have reached the cache.
void TakeTriangles(const std::uint32_t* ids, int inside, SurfacePoints& points) {
  static_assert(sizeof(TriangleId) == sizeof(std::uint32_t) && sizeof(bool) == 1);
  alignas(64) std::uint32_t ids_or_none[kPacket];
  alignas(16) std::uint8_t hit[kPacket];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) ids_or_none[i] = i < inside ? ids[i] : kNoTriangle;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) hit[i] = ids_or_none[i] != kNoTriangle ? 1 : 0;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) ids_or_none[i] = ids_or_none[i] != kNoTriangle ? ids_or_none[i] : 0;
  std::memcpy(static_cast<void*>(points.triangle), ids_or_none, sizeof ids_or_none);
  std::memcpy(points.hit, hit, sizeof hit);
}

void LitLanes(const SurfacePoints& p, const Shading& shading, const std::int32_t* facing, float* lit) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) lit[i] = p.hit[i] && facing[i] && shading.mu0[i] > 0 ? 1.F : 0.F;
}

bool AllLitInside(const SurfacePoints& p, const float* lit) {
  int excluded = 0;
  for (int i = 0; i < kPacket; ++i)
    excluded |= (lit[i] > 0 ? 0 : 1) | (p.v[i] <= kEdge ? 1 : 0) | (p.w[i] <= kEdge ? 1 : 0) |
                (1 - p.v[i] - p.w[i] <= kEdge ? 1 : 0);
  return excluded == 0;
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(TakeTriangles);
HWY_EXPORT(LitLanes);
HWY_EXPORT(AllLitInside);

void take_triangles(const std::uint32_t* ids, int inside, SurfacePoints& points) {
  HWY_DYNAMIC_DISPATCH(TakeTriangles)(ids, inside, points);
}

void lit_lanes(const SurfacePoints& points, const Shading& shading, const std::int32_t* facing, float* lit) {
  HWY_DYNAMIC_DISPATCH(LitLanes)(points, shading, facing, lit);
}

bool all_lit_inside(const SurfacePoints& points, const float* lit) {
  return HWY_DYNAMIC_DISPATCH(AllLitInside)(points, lit);
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
