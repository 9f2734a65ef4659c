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

// In whole vectors: what is stored in pieces and then loaded whole waits until all stores before it are through.
void TakeTriangles(const std::uint32_t* ids, int inside, SurfacePoints& points) {
  static_assert(sizeof(TriangleId) == sizeof(std::uint32_t) && sizeof(bool) == 1);
  alignas(64) std::uint32_t taken[kPacket];
  alignas(16) std::uint8_t hit[kPacket];
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) taken[i] = i < inside ? ids[i] : kNoTriangle;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) hit[i] = taken[i] != kNoTriangle ? 1 : 0;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) taken[i] = taken[i] != kNoTriangle ? taken[i] : 0;
  std::memcpy(static_cast<void*>(points.triangle), taken, sizeof taken);
  std::memcpy(points.hit, hit, sizeof hit);
}

void LitLanes(const SurfacePoints& p, const Shading& shading, const std::int32_t* facing, float* lit) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) lit[i] = p.hit[i] && facing[i] && shading.mu0[i] > 0 ? 1.F : 0.F;
}

bool AllLitInside(const SurfacePoints& p, const float* lit) {
  int some = 0;
  for (int i = 0; i < kPacket; ++i)
    some |= (lit[i] > 0 ? 0 : 1) | (p.v[i] <= kEdge ? 1 : 0) | (p.w[i] <= kEdge ? 1 : 0) |
            (1 - p.v[i] - p.w[i] <= kEdge ? 1 : 0);
  return some == 0;
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
