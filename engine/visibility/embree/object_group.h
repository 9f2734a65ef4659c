// Many objects of few shapes as instances in one acceleration structure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "engine/support/affine.h"
#include "engine/visibility/embree/embree.h"
#include "engine/visibility/embree/object_tracer.h"

namespace selenograph::engine {

class ObjectGroup {
 public:
  static constexpr std::uint32_t kNone = ~0U;
  struct Instance {
    const ObjectTracer* tracer;
    Affine group_from_tracer;  // transforms tracer coordinates to those of the group
  };

  // Calls `instance` for each index below `count`; the instances' tracers must outlive the group.
  ObjectGroup(std::size_t count, const std::function<Instance(std::size_t)>& instance, const StopToken& stop = {});

  // Finds the first instance that each active ray hits, or kNone, and the triangle of it.
  void intersect(const RayPacket& rays, std::uint32_t instance[kPacket], std::uint32_t triangle[kPacket]) const;
  void occluded(const RayPacket& rays, bool blocked[kPacket]) const;

 private:
  EmbreeScene scene_;
};

}  // namespace selenograph::engine
