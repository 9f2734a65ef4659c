// Which triangle of the terrain does a ray meet first, and is the way to the Sun free.
//
// Vertices are float relative to an anchor near the scene; one grid geometry per mesh block.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

#include "dem/support/stop_token.h"
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

  // The triangle that each ray meets first. Float decides which; where exactly is for refine.h.
  // Sets `hit` and `triangle` of the points.
  void intersect(const RayPacket& rays, SurfacePoints& points) const;

  // blocked[i]: something stands in the way along the (common, unit) direction toward the Sun. Triangles that face the
  // Sun don't count where they are the surface that the ray leaves: where it starts less than `rounding_m` beneath
  // their plane. That makes an offset needless. From deeper beneath one it comes out of the ground, wherever it went
  // in: next to where it starts, perhaps, in a crease.
  void occluded(const RayPacket& rays, const Vec3& sun_direction, float rounding_m, bool blocked[kPacket]) const;

  std::size_t bytes() const { return bytes_; }

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  Vec3 anchor_;
  std::size_t bytes_ = 0;
};

}  // namespace selenograph::engine
