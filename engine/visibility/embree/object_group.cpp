#include "engine/visibility/embree/object_group.h"

#include <tbb/task_arena.h>

namespace selenograph::engine {

// Use the device of the tracers: Embree requires it for instances.
ObjectGroup::ObjectGroup(std::size_t count, const std::function<Instance(std::size_t)>& instance, const StopToken& stop)
    : scene_(count, ObjectTracer::kThreads, EmbreeScene::Filters::none) {
  for (std::size_t i = 0; i < count; ++i) {
    const Instance current = instance(i);
    scene_.set_instance(i, current.tracer->scene(), current.group_from_tracer);
  }
  tbb::task_arena(1).execute([&] { scene_.build(stop); });
}

void ObjectGroup::occluded(const RayPacket& rays, bool blocked[kPacket]) const {
  scene_.occluded(rays, blocked, {}, EmbreeScene::Bundles::never);
}

void ObjectGroup::intersect(const RayPacket& rays, std::uint32_t instance[kPacket],
                            std::uint32_t triangle[kPacket]) const {
  RayHits hits;
  scene_.intersect(rays, hits, EmbreeScene::Bundles::never);
  for (int i = 0; i < kPacket; ++i) {
    const bool hit = rays.active[i] && hits.geometry[i] != RayHits::kNone;
    instance[i] = hit ? hits.instance[i] : kNone;
    triangle[i] = hits.primitive[i];
  }
}

}  // namespace selenograph::engine
