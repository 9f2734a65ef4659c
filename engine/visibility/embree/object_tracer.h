// Ray queries on an object's triangles, two-sided, in the object's own coordinates relative to its middle: first hit
// and occlusion.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/scene/object_shape.h"
#include "engine/visibility/embree/embree.h"

namespace selenograph::engine {

class ObjectTracer {
 public:
  static constexpr std::uint32_t kNone = ~0U;
  static constexpr int kThreads = 0;  // number of threads of its device: all cores

  // `middle`: in the shape's coordinates; rays are relative to it. Throws Cancelled when `stop` says so.
  ObjectTracer(const ObjectShape& shape, const Vec3& middle, const StopToken& stop = {});

  // Memory of the structure, measured (Embree 3.13): 83 bytes per triangle besides its buffers.
  static std::size_t bytes_for(const ObjectShape& shape) {
    return shape.corners.size() * 12 + shape.triangles.size() * (12 + 83);
  }

  // Sets the index of the first triangle that each active ray hits, or kNone.
  void intersect(const RayPacket& rays, std::uint32_t triangle[kPacket]) const;
  // Sets blocked[i] if the active ray hits any triangle.
  void occluded(const RayPacket& rays, bool blocked[kPacket]) const;
  const EmbreeScene& scene() const { return *scene_; }

 private:
  std::unique_ptr<EmbreeScene> scene_;
};

}  // namespace selenograph::engine
