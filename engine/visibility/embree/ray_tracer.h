// Ray queries on the terrain: first hit, and occlusion toward the Sun.
//
// Vertices are float relative to an anchor near the scene; each mesh block is one grid geometry.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "dem/base/stop_token.h"
#include "engine/scene/mesh.h"
#include "engine/support/packet.h"
#include "engine/visibility/embree/embree.h"

namespace selenograph::engine {

class RayTracer {
 public:
  // Throws Cancelled when `stop` says so.
  RayTracer(const Mesh& mesh, const Vec3& anchor_m, int threads, const StopToken& stop = {});
  ~RayTracer();
  RayTracer(const RayTracer&) = delete;
  RayTracer& operator=(const RayTracer&) = delete;

  const Vec3& anchor() const { return anchor_; }

  // Finds the first triangle that each ray hits, in float; refine.h computes the exact point. Sets `hit` and `triangle`
  // of the points.
  void intersect(const RayPacket& rays, SurfacePoints& points) const;

  // Sets blocked[i] if the ray along the (common, unit) direction toward the Sun is blocked.
  //
  // A triangle that faces the Sun is ignored if the ray starts less than `rounding_m` below its plane: it is the
  // surface that the ray leaves, so no offset is needed. A ray that starts deeper comes out of the ground and is
  // blocked, even by a triangle next to its start, as in a crease. Within burial_m[i] of its start, though, a flat ray
  // may be below ground by rounding alone and come out of a neighbouring triangle: that blocks nothing either.
  void occluded(const RayPacket& rays, const Vec3& sun_direction, float rounding_m, const float* burial_m,
                bool blocked[kPacket]) const;

  std::size_t bytes() const { return bytes_; }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  Vec3 anchor_;
  std::size_t bytes_ = 0;
};

}  // namespace selenograph::engine
