#include "engine/visibility/image/flow.h"

#include <bit>
#include <cmath>
#include <limits>

#include "engine/visibility/points/trace.h"

namespace selenograph::engine {
namespace {

// Returns the tolerance of a distance: the ray to a point hits that point itself at its distance, up to the rounding of
// lunar coordinates in double.
double tolerance_m(double distance_m) { return 1e-6 + 1e-12 * distance_m; }

}  // namespace

// Projects the points of the requested lanes into the second image; NaN where it does not show them.
void Flow::find(const SurfacePoints& points, std::uint32_t lanes, PixelPositions& out) const {
  Vec3 camera_m[kPacket];
  std::uint32_t imaged = 0;
  for (int i = 0; i < kPacket; ++i) {
    out.x[i] = out.y[i] = std::numeric_limits<double>::quiet_NaN();
    if (!(lanes >> i & 1)) continue;
    const Vec3 position = points.position(i);
    if (to_.vary()) {
      const auto sighting = to_.find(position);
      if (!sighting) continue;
      out.x[i] = sighting->pixel.x;
      out.y[i] = sighting->pixel.y;
      camera_m[i] = sighting->camera_m;
    } else {
      const auto pixel = to_.reference().project(position);
      if (!pixel) continue;
      out.x[i] = pixel->x;
      out.y[i] = pixel->y;
      camera_m[i] = to_.reference().position();
    }
    imaged |= 1U << i;
  }
  const std::uint32_t hidden_lanes = imaged ? hidden(points, imaged, camera_m) : 0;
  for (int i = 0; i < kPacket; ++i)
    if (hidden_lanes >> i & 1) out.x[i] = out.y[i] = std::numeric_limits<double>::quiet_NaN();
}

// Returns the requested lanes whose point something nearer hides from its camera. Other lanes get a copy of a valid
// ray.
std::uint32_t Flow::hidden(const SurfacePoints& points, std::uint32_t requested,
                           const Vec3 (&camera_m)[kPacket]) const {
  Rays rays;
  double distance_m[kPacket];
  const int source = std::countr_zero(requested);
  for (int i = 0; i < kPacket; ++i) {
    const int lane = requested >> i & 1 ? i : source;
    const Vec3 to_point = points.position(lane) - camera_m[lane];
    distance_m[i] = to_point.norm();
    rays.set(i, camera_m[lane], to_point / distance_m[i]);
    rays.valid[i] = lane == i;
  }
  SurfacePoints terrain;
  if (job_.request.terrain)
    trace(job_.scene, rays, terrain);
  else
    for (int i = 0; i < kPacket; ++i) terrain.hit[i] = terrain.toward_moon[i] = false;
  ObjectLanes objects;
  const std::uint32_t on_objects = job_.objects.empty() ? 0 : job_.objects.intersect(rays, terrain, objects, false);
  std::uint32_t hidden_lanes = 0;
  for (int i = 0; i < kPacket; ++i) {
    if (!(requested >> i & 1)) continue;
    const bool hits_object = on_objects >> i & 1;
    const double nearest_m = hits_object      ? objects.points.distance[i]
                             : terrain.hit[i] ? terrain.distance[i]
                                              : distance_m[i];
    if (nearest_m < distance_m[i] - tolerance_m(distance_m[i])) hidden_lanes |= 1U << i;
  }
  return hidden_lanes;
}

}  // namespace selenograph::engine
