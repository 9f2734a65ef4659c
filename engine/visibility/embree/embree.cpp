#include "engine/visibility/embree/embree.h"

// Look for version 4 first, as CMakeLists.txt does.
#if __has_include(<embree4/rtcore.h>)
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif
#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <mutex>
#include <numeric>
#include <stdexcept>
#include <unordered_map>
#include <vector>

namespace selenograph::engine {
namespace {

using Filter = EmbreeScene::Filter;
using Bundles = EmbreeScene::Bundles;

// The context of one query. Embree passes the address of its first member to filters, which cast it back to `Query`.
#if RTC_VERSION_MAJOR >= 4
struct Query {
  RTCRayQueryContext embree;
  const Filter* filter;
};
constexpr auto kCoherent = RTC_RAY_QUERY_FLAG_COHERENT, kIncoherent = RTC_RAY_QUERY_FLAG_INCOHERENT;

void intersect16(const int* active, RTCScene scene, RTCRayQueryFlags flags, RTCRayHit16& ray_hit) {
  RTCRayQueryContext context;
  rtcInitRayQueryContext(&context);
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = flags;
  arguments.context = &context;
  rtcIntersect16(active, scene, &ray_hit, &arguments);
}

void occluded16(const int* active, RTCScene scene, RTCRayQueryFlags flags, const Filter& filter, RTCRay16& ray) {
  Query query{{}, &filter};
  rtcInitRayQueryContext(&query.embree);
  RTCOccludedArguments arguments;
  rtcInitOccludedArguments(&arguments);
  arguments.flags = flags;
  arguments.context = &query.embree;
  rtcOccluded16(active, scene, &ray, &arguments);
}
#else
struct Query {
  RTCIntersectContext embree;
  const Filter* filter;
};
constexpr auto kCoherent = RTC_INTERSECT_CONTEXT_FLAG_COHERENT, kIncoherent = RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;

void intersect16(const int* active, RTCScene scene, RTCIntersectContextFlags flags, RTCRayHit16& ray_hit) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = flags;
  rtcIntersect16(active, scene, &context, &ray_hit);
}

void occluded16(const int* active, RTCScene scene, RTCIntersectContextFlags flags, const Filter& filter,
                RTCRay16& ray) {
  Query query{{}, &filter};
  rtcInitIntersectContext(&query.embree);
  query.embree.flags = flags;
  rtcOccluded16(active, scene, &query.embree, &ray);
}
#endif

void call_filter(const RTCFilterFunctionNArguments* args) {
  const std::size_t n = args->N;
  const float* normal = &RTCHitN_Ng_x(args->hit, args->N, 0);
  (*reinterpret_cast<const Query*>(args->context)->filter)({n, normal, normal + n, normal + 2 * n,
                                                            &RTCRayN_tfar(args->ray, args->N, 0),
                                                            &RTCRayN_id(args->ray, args->N, 0), args->valid});
}

// Returns the device for a number of threads. There is one for the whole process, because a device owns worker threads.
RTCDevice device_for(int threads) {
  static std::mutex mutex;
  static std::unordered_map<int, RTCDevice> devices;
  std::lock_guard lock(mutex);
  RTCDevice& d = devices[threads];
  if (!d) d = rtcNewDevice(threads > 0 ? fmt::format("threads={}", threads).c_str() : nullptr);
  if (!d)
    throw std::runtime_error(fmt::format("Embree: no device (error {})", static_cast<int>(rtcGetDeviceError(nullptr))));
  return d;
}

// Returns whether each direction component has one sign in all rays and is clear of zero: bundles of Embree 3.13 lose
// hits if a component is (nearly) zero for some rays and not for others.
bool safe_as_bundle(const RayPacket& rays) {
  constexpr float kClear = 0x1p-10F;
  const float* const axes[3] = {rays.dx, rays.dy, rays.dz};
  float low[3], high[3];
  for (int k = 0; k < 3; ++k) {
    // Keep four running bounds: a single one would be a chain of dependent instructions, about 1 % of a ray-traced
    // frame.
    float lows[4], highs[4];
    std::copy_n(axes[k], 4, lows);
    std::copy_n(axes[k], 4, highs);
    for (int i = 4; i < kPacket; i += 4)
      for (int j = 0; j < 4; ++j) {
        lows[j] = std::min(axes[k][i + j], lows[j]);
        highs[j] = std::max(axes[k][i + j], highs[j]);
      }
    low[k] = *std::min_element(lows, lows + 4);
    high[k] = *std::max_element(highs, highs + 4);
  }
  const float size = std::max({-low[0], -low[1], -low[2], high[0], high[1], high[2]});
  for (int k = 0; k < 3; ++k)
    if (!(low[k] > kClear * size || high[k] < -kClear * size)) return false;
  return true;
}

auto flags_for(const RayPacket& rays, Bundles bundles) {
  const bool bundled = bundles == Bundles::always || (bundles == Bundles::where_safe && safe_as_bundle(rays));
  return bundled ? kCoherent : kIncoherent;
}

template <typename T>
void copy(const T (&from)[kPacket], T (&to)[kPacket]) {
  std::memcpy(to, from, sizeof from);
}

void set_rays(const RayPacket& in, RTCRay16& out) {
  copy(in.ox, out.org_x);
  copy(in.oy, out.org_y);
  copy(in.oz, out.org_z);
  copy(in.dx, out.dir_x);
  copy(in.dy, out.dir_y);
  copy(in.dz, out.dir_z);
  std::fill_n(out.tfar, kPacket, std::numeric_limits<float>::infinity());
  copy(in.near, out.tnear);
  std::fill_n(out.time, kPacket, 0.F);
  std::fill_n(out.mask, kPacket, ~0U);
  std::fill_n(out.flags, kPacket, 0U);
  std::iota(out.id, out.id + kPacket, 0U);
}

// Returns whether building should go on. tests/tsan.supp contains the name of this function.
bool goes_on_building(void* stop, double) { return !static_cast<const StopToken*>(stop)->stopped(); }

}  // namespace

struct EmbreeScene::Impl {
  Impl(std::size_t count, int threads, Filters filters_in)
      : filters(filters_in), device(device_for(threads)), scene(rtcNewScene(device)), geometries(count) {
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
  }
  ~Impl() {
    for (RTCGeometry geometry : geometries)
      if (geometry) rtcReleaseGeometry(geometry);
    rtcReleaseScene(scene);
  }
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;

  RTCGeometry start(std::size_t index, RTCGeometryType type) {
    RTCGeometry geometry = geometries[index] = rtcNewGeometry(device, type);
    if (filters == Filters::on_occlusion) rtcSetGeometryOccludedFilterFunction(geometry, call_filter);
    return geometry;
  }
  template <typename T>
  std::span<T> buffer(RTCGeometry geometry, RTCBufferType type, RTCFormat format, std::size_t components,
                      std::size_t count) const {
    auto* data = static_cast<T*>(rtcSetNewGeometryBuffer(geometry, type, 0, format, components * sizeof(T), count));
    if (!data) check();
    return {data, components * count};
  }
  void check() const { check(rtcGetDeviceError(device)); }
  static void check(RTCError error) {
    if (error != RTC_ERROR_NONE)
      throw std::runtime_error(fmt::format("Embree: building the scene failed (error {})", static_cast<int>(error)));
  }

  const Filters filters;
  const RTCDevice device;
  const RTCScene scene;
  std::vector<RTCGeometry> geometries;  // owned until build() attaches them to the scene
};

EmbreeScene::EmbreeScene(std::size_t geometries, int threads, Filters filters)
    : impl_(std::make_unique<Impl>(geometries, threads, filters)) {}
EmbreeScene::~EmbreeScene() = default;

void EmbreeScene::set_grid(std::size_t geometry, int side, const std::function<void(std::span<float>)>& vertices) {
  RTCGeometry new_geometry = impl_->start(geometry, RTC_GEOMETRY_TYPE_GRID);
  const auto count = static_cast<std::size_t>(side);
  vertices(impl_->buffer<float>(new_geometry, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, 3, count * count));
  impl_->buffer<RTCGrid>(new_geometry, RTC_BUFFER_TYPE_GRID, RTC_FORMAT_GRID, 1, 1)[0] = {
      0, static_cast<unsigned>(side), static_cast<std::uint16_t>(side), static_cast<std::uint16_t>(side)};
  rtcCommitGeometry(new_geometry);
}

void EmbreeScene::set_triangles(std::size_t geometry, std::size_t vertex_count, std::size_t triangle_count,
                                const std::function<void(std::span<float>)>& vertices,
                                const std::function<void(std::span<std::uint32_t>)>& triangles) {
  RTCGeometry new_geometry = impl_->start(geometry, RTC_GEOMETRY_TYPE_TRIANGLE);
  vertices(impl_->buffer<float>(new_geometry, RTC_BUFFER_TYPE_VERTEX, RTC_FORMAT_FLOAT3, 3, vertex_count));
  triangles(impl_->buffer<std::uint32_t>(new_geometry, RTC_BUFFER_TYPE_INDEX, RTC_FORMAT_UINT3, 3, triangle_count));
  rtcCommitGeometry(new_geometry);
}

void EmbreeScene::set_instance(std::size_t geometry, const EmbreeScene& of, const Affine& scene_from_instance) {
  RTCGeometry new_geometry = impl_->start(geometry, RTC_GEOMETRY_TYPE_INSTANCE);
  rtcSetGeometryInstancedScene(new_geometry, of.impl_->scene);
  Vec3f columns[4];
  for (int i = 0; i < 3; ++i) columns[i] = scene_from_instance.linear.col(i).cast<float>();
  columns[3] = scene_from_instance.translation.cast<float>();
  rtcSetGeometryTransform(new_geometry, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns);
  rtcCommitGeometry(new_geometry);
}

// Hands the geometries over to the scene, and builds its acceleration structure.
void EmbreeScene::build(const StopToken& stop) {
  for (std::size_t i = 0; i < impl_->geometries.size(); ++i) {
    RTCGeometry& geometry = impl_->geometries[i];
    if (!geometry) continue;
    rtcAttachGeometryByID(impl_->scene, geometry, static_cast<unsigned>(i));
    rtcReleaseGeometry(geometry);
    geometry = nullptr;
  }
  // Embree calls the monitor repeatedly during the build.
  rtcSetSceneProgressMonitorFunction(impl_->scene, goes_on_building, const_cast<StopToken*>(&stop));
  rtcCommitScene(impl_->scene);
  const RTCError error = rtcGetDeviceError(impl_->device);
  stop.check();  // throw Cancelled first: a stopped build also reports an error
  impl_->check(error);
  rtcSetSceneProgressMonitorFunction(impl_->scene, nullptr, nullptr);
}

void EmbreeScene::intersect(const RayPacket& rays, RayHits& hits, Bundles bundles) const {
  static_assert(RayHits::kNone == RTC_INVALID_GEOMETRY_ID);
  RTCRayHit16 found;
  set_rays(rays, found.ray);
  std::fill_n(found.hit.geomID, kPacket, RTC_INVALID_GEOMETRY_ID);
  std::fill_n(found.hit.instID[0], kPacket, RTC_INVALID_GEOMETRY_ID);
  intersect16(rays.active, impl_->scene, flags_for(rays, bundles), found);
  copy(found.hit.geomID, hits.geometry);
  copy(found.hit.primID, hits.primitive);
  copy(found.hit.instID[0], hits.instance);
  copy(found.hit.u, hits.u);
  copy(found.hit.v, hits.v);
  copy(found.ray.tfar, hits.distance);
  copy(found.hit.Ng_x, hits.nx);
  copy(found.hit.Ng_y, hits.ny);
  copy(found.hit.Ng_z, hits.nz);
}

void EmbreeScene::occluded(const RayPacket& rays, bool blocked[kPacket], const Filter& filter, Bundles bundles) const {
  RTCRay16 shadow;
  set_rays(rays, shadow);
  occluded16(rays.active, impl_->scene, flags_for(rays, bundles), filter, shadow);
  for (int i = 0; i < kPacket; ++i) blocked[i] = rays.active[i] && shadow.tfar[i] < 0;
}

}  // namespace selenograph::engine
