#include "engine/ray_tracer.h"

#include "engine/vectorise.h"

#include <embree3/rtcore.h>
#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <stdexcept>

namespace selenograph::engine {
namespace {

// One device per thread count for the whole process: a device owns worker threads.
RTCDevice device(int threads) {
  static std::mutex mutex;
  static std::unordered_map<int, RTCDevice> devices;
  std::lock_guard lock(mutex);
  RTCDevice& d = devices[threads];
  if (!d) d = rtcNewDevice(threads > 0 ? fmt::format("threads={}", threads).c_str() : nullptr);
  if (!d) throw std::runtime_error(fmt::format("Embree: no device (error {})", static_cast<int>(rtcGetDeviceError(nullptr))));
  return d;
}

struct SunContext {
  RTCIntersectContext embree;  // first member: Embree hands its address to the filter
  float sun[3];
};

// Drops candidates that face the Sun.
SELENOGRAPH_VECTORISED
void ignore_sunlit_side16(const float* nx, const float* ny, const float* nz, const float* sun, int* valid) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) valid[i] = nx[i] * sun[0] + ny[i] * sun[1] + nz[i] * sun[2] >= 0 ? 0 : valid[i];
}

void ignore_sunlit_side(const RTCFilterFunctionNArguments* args) {
  const auto* context = reinterpret_cast<const SunContext*>(args->context);
  if (args->N == kPacket) {
    const float* n = &RTCHitN_Ng_x(args->hit, kPacket, 0);
    ignore_sunlit_side16(n, n + kPacket, n + 2 * kPacket, context->sun, args->valid);
    return;
  }
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] != -1) continue;
    const float facing = RTCHitN_Ng_x(args->hit, args->N, i) * context->sun[0] + RTCHitN_Ng_y(args->hit, args->N, i) * context->sun[1] +
                         RTCHitN_Ng_z(args->hit, args->N, i) * context->sun[2];
    if (facing >= 0) args->valid[i] = 0;
  }
}

void fill_vertices(const MeshBlock& block, const Vec3& anchor, float* out) {
  const int side = block.posts->side();
  for (int r = 0; r < side; ++r)
    for (int c = 0; c < side; ++c) {
      // NaN posts make Embree drop the quads around them: a hole where there is no data.
      const Vec3 p = block.vertex(r, c) - anchor;
      for (int k = 0; k < 3; ++k) *out++ = static_cast<float>(p[k]);
    }
}

template <typename Packet>
void set_rays(const RayPacket& in, Packet& out) {
  std::memcpy(out.org_x, in.ox, sizeof in.ox), std::memcpy(out.org_y, in.oy, sizeof in.oy), std::memcpy(out.org_z, in.oz, sizeof in.oz);
  std::memcpy(out.dir_x, in.dx, sizeof in.dx), std::memcpy(out.dir_y, in.dy, sizeof in.dy), std::memcpy(out.dir_z, in.dz, sizeof in.dz);
  std::fill_n(out.tfar, kPacket, std::numeric_limits<float>::infinity());
  std::fill_n(out.tnear, kPacket, in.near), std::fill_n(out.time, kPacket, 0.F);
  std::fill_n(out.mask, kPacket, ~0U), std::fill_n(out.flags, kPacket, 0U);
}

}  // namespace

struct RayTracer::Impl {
  RTCScene scene = nullptr;
  std::vector<int> quads;  // per geometry
  ~Impl() {
    if (scene) rtcReleaseScene(scene);
  }
};

RayTracer::RayTracer(const Mesh& mesh, const Vec3& anchor_m, int threads) : impl_(std::make_unique<Impl>()), anchor_(anchor_m) {
  const RTCDevice dev = device(threads);
  impl_->scene = rtcNewScene(dev);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  std::vector<RTCGeometry> geometries;
  for (const MeshBlock& block : mesh.blocks()) {
    const auto side = static_cast<std::size_t>(block.posts->side());
    RTCGeometry geometry = rtcNewGeometry(dev, RTC_GEOMETRY_TYPE_GRID);
    rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), side * side);
    auto* grid = static_cast<RTCGrid*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_GRID, 0, RTC_FORMAT_GRID, sizeof(RTCGrid), 1));
    *grid = {0, static_cast<unsigned>(side), static_cast<std::uint16_t>(side), static_cast<std::uint16_t>(side)};
    rtcSetGeometryOccludedFilterFunction(geometry, ignore_sunlit_side);
    geometries.push_back(geometry);
    impl_->quads.push_back(block.posts->extent.quads);
    bytes_ += side * side * 12 + static_cast<std::size_t>(block.posts->extent.quads) * static_cast<std::size_t>(block.posts->extent.quads) * 2 * 15;
  }
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(std::size_t{0}, geometries.size(), [&](std::size_t i) {
      fill_vertices(mesh.blocks()[i], anchor_, static_cast<float*>(rtcGetGeometryBufferData(geometries[i], RTC_BUFFER_TYPE_VERTEX, 0)));
      rtcCommitGeometry(geometries[i]);
    });
    for (std::size_t i = 0; i < geometries.size(); ++i) {
      rtcAttachGeometryByID(impl_->scene, geometries[i], static_cast<unsigned>(i));
      rtcReleaseGeometry(geometries[i]);
    }
    rtcCommitScene(impl_->scene);
  });
  if (const RTCError error = rtcGetDeviceError(dev); error != RTC_ERROR_NONE)
    throw std::runtime_error(fmt::format("Embree: building the scene failed (error {})", static_cast<int>(error)));
}

RayTracer::~RayTracer() = default;

void* RayTracer::native_scene() const { return impl_->scene; }

void RayTracer::intersect(const RayPacket& rays, SurfacePoints& points) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  RTCRayHit16 rh;
  set_rays(rays, rh.ray);
  std::fill_n(rh.hit.geomID, kPacket, RTC_INVALID_GEOMETRY_ID);
  std::fill_n(rh.hit.instID[0], kPacket, RTC_INVALID_GEOMETRY_ID);
  rtcIntersect16(rays.active, impl_->scene, &context, &rh);
  for (int i = 0; i < kPacket; ++i) {
    points.hit[i] = rays.active[i] && rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
    if (!points.hit[i]) continue;
    // A grid's u and v run over the whole grid: the quad follows from its size. Rounding at a quad's border is for refine.h.
    const int quads = impl_->quads[rh.hit.geomID[i]];
    const float u = rh.hit.u[i] * static_cast<float>(quads), v = rh.hit.v[i] * static_cast<float>(quads);
    const int c = std::clamp(static_cast<int>(u), 0, quads - 1), r = std::clamp(static_cast<int>(v), 0, quads - 1);
    points.triangle[i] = {rh.hit.geomID[i], static_cast<std::uint16_t>(r), static_cast<std::uint16_t>(c),
                        (u - static_cast<float>(c)) + (v - static_cast<float>(r)) > 1.F};
  }
}

void RayTracer::occluded(const RayPacket& rays, const Vec3& sun_direction, bool blocked[kPacket]) const {
  SunContext context;
  rtcInitIntersectContext(&context.embree);
  context.embree.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  for (int k = 0; k < 3; ++k) context.sun[k] = static_cast<float>(sun_direction[k]);
  RTCRay16 shadow;
  set_rays(rays, shadow);
  rtcOccluded16(rays.active, impl_->scene, &context.embree, &shadow);
  for (int i = 0; i < kPacket; ++i) blocked[i] = rays.active[i] && shadow.tfar[i] < 0;
}

}  // namespace selenograph::engine
