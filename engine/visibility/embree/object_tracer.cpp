#include "engine/visibility/embree/object_tracer.h"

#include <tbb/task_arena.h>

#include <algorithm>

namespace selenograph::engine {

ObjectTracer::ObjectTracer(const ObjectShape& shape, const Vec3& middle, const StopToken& stop)
    : scene_(std::make_unique<EmbreeScene>(1, kThreads, EmbreeScene::Filters::none)) {
  scene_->set_triangles(
      0, shape.corners.size(), shape.triangles.size(),
      [&](std::span<float> out) {
        float* vertex = out.data();
        for (const ObjectCorner& corner : shape.corners) {
          const Vec3f relative = (corner.place.cast<double>() - middle).cast<float>();
          vertex = std::copy_n(relative.data(), 3, vertex);
        }
      },
      [&](std::span<std::uint32_t> out) {
        std::uint32_t* corners = out.data();
        for (const ObjectTriangle& t : shape.triangles) corners = std::copy_n(t.corner.data(), 3, corners);
      });
  // Build on the calling thread alone: this happens once per file, and frames in progress keep their threads.
  tbb::task_arena(1).execute([&] { scene_->build(stop); });
}

void ObjectTracer::intersect(const RayPacket& rays, std::uint32_t triangle[kPacket]) const {
  RayHits hits;
  scene_->intersect(rays, hits);
  for (int i = 0; i < kPacket; ++i)
    triangle[i] = rays.active[i] && hits.geometry[i] != RayHits::kNone ? hits.primitive[i] : kNone;
}

void ObjectTracer::occluded(const RayPacket& rays, bool blocked[kPacket]) const { scene_->occluded(rays, blocked); }

}  // namespace selenograph::engine
