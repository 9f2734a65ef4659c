#include "engine/visibility/raytrace/object_tracer.h"

#include <tbb/task_arena.h>

#include "engine/visibility/raytrace/embree_packets.h"

namespace selenograph::engine {

struct ObjectTracer::Impl {
  ~Impl() {
    if (scene) rtcReleaseScene(scene);
  }
  RTCScene scene = nullptr;
};

ObjectTracer::ObjectTracer(const ObjectShape& shape, const Vec3& middle) : impl_(std::make_unique<Impl>()) {
  const RTCDevice device = embree_device(0);
  impl_->scene = rtcNewScene(device);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* places = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                             3 * sizeof(float), shape.corners.size()));
  for (const ObjectCorner& corner : shape.corners) {
    const Eigen::Vector3f place = (corner.place.cast<double>() - middle).cast<float>();
    places = std::copy_n(place.data(), 3, places);
  }
  auto* indices = static_cast<unsigned*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                 3 * sizeof(unsigned), shape.triangles.size()));
  for (const ObjectTriangle& t : shape.triangles) indices = std::copy_n(t.corner.data(), 3, indices);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(impl_->scene, geometry);
  rtcReleaseGeometry(geometry);
  // By the thread that reads the file, alone: once per file, and frames in work keep theirs.
  tbb::task_arena(1).execute([&] { rtcCommitScene(impl_->scene); });
  check_embree(device);
}

ObjectTracer::~ObjectTracer() = default;
ObjectTracer::ObjectTracer(ObjectTracer&&) noexcept = default;
ObjectTracer& ObjectTracer::operator=(ObjectTracer&&) noexcept = default;

void ObjectTracer::intersect(const RayPacket& rays, std::uint32_t triangle[kPacket]) const {
  RTCRayHit16 rh;
  engine::intersect(impl_->scene, rays, rh);
  for (int i = 0; i < kPacket; ++i)
    triangle[i] = rays.active[i] && rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID ? rh.hit.primID[i] : kNone;
}

void ObjectTracer::occluded(const RayPacket& rays, bool blocked[kPacket]) const {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  engine::occluded(impl_->scene, rays, context, blocked);
}

}  // namespace selenograph::engine
