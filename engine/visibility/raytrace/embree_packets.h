// What all acceleration structures have in common: Embree's device, and rays as it takes them. For ray_tracer.cpp and
// object_tracer.cpp only: nobody else sees Embree.
#pragma once

#include <embree3/rtcore.h>

#include <algorithm>
#include <cstring>
#include <limits>

#include "engine/visibility/raytrace/ray_tracer.h"

namespace selenograph::engine {

// One device per thread count for the whole process: a device owns worker threads. 0: all cores.
RTCDevice embree_device(int threads);
// Throws std::runtime_error when the device has an error: memory, most likely.
void check_embree(RTCDevice device);

// How a packet is traced: as one bundle when its directions are alike.
RTCIntersectContextFlags coherence(const RayPacket& rays);

template <typename Packet>
void set_rays(const RayPacket& in, Packet& out) {
  std::memcpy(out.org_x, in.ox, sizeof in.ox), std::memcpy(out.org_y, in.oy, sizeof in.oy),
      std::memcpy(out.org_z, in.oz, sizeof in.oz);
  std::memcpy(out.dir_x, in.dx, sizeof in.dx), std::memcpy(out.dir_y, in.dy, sizeof in.dy),
      std::memcpy(out.dir_z, in.dz, sizeof in.dz);
  std::fill_n(out.tfar, kPacket, std::numeric_limits<float>::infinity());
  std::memcpy(out.tnear, in.near, sizeof in.near), std::fill_n(out.time, kPacket, 0.F);
  std::fill_n(out.mask, kPacket, ~0U), std::fill_n(out.flags, kPacket, 0U);
}

// What each ray meets first; a geomID of RTC_INVALID_GEOMETRY_ID: nothing.
inline void intersect(RTCScene scene, const RayPacket& rays, RTCRayHit16& out) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = coherence(rays);
  set_rays(rays, out.ray);
  std::fill_n(out.hit.geomID, kPacket, RTC_INVALID_GEOMETRY_ID);
  std::fill_n(out.hit.instID[0], kPacket, RTC_INVALID_GEOMETRY_ID);
  rtcIntersect16(rays.active, scene, &context, &out);
}

// Whether anything that the context's filter lets count stands in each active ray's way.
inline void occluded(RTCScene scene, const RayPacket& rays, RTCIntersectContext& context, bool blocked[kPacket]) {
  context.flags = coherence(rays);
  RTCRay16 shadow;
  set_rays(rays, shadow);
  rtcOccluded16(rays.active, scene, &context, &shadow);
  for (int i = 0; i < kPacket; ++i) blocked[i] = rays.active[i] && shadow.tfar[i] < 0;
}

}  // namespace selenograph::engine
