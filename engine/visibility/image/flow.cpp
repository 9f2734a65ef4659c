#include "engine/visibility/image/flow.h"

#include <bit>
#include <cmath>
#include <limits>

#include "engine/visibility/points/trace.h"

namespace selenograph::engine {
namespace {

// The ray to a point meets the point itself at its own distance, to within double's rounding of lunar coordinates.
double rounding_m(double distance_m) { return 1e-6 + 1e-12 * distance_m; }

}  // namespace

void Flow::find(const SurfacePoints& points, std::uint32_t lanes, Places& out) const {
  Vec3 camera_m[kPacket];
  std::uint32_t imaged = 0;
  for (int i = 0; i < kPacket; ++i) {
    out.x[i] = out.y[i] = std::numeric_limits<double>::quiet_NaN();
    if (!(lanes >> i & 1)) continue;
    const Vec3 place = points.position(i);
    if (to_.vary()) {
      const auto sighting = to_.find(place);
      if (!sighting) continue;
      out.x[i] = sighting->pixel.x;
      out.y[i] = sighting->pixel.y;
      camera_m[i] = sighting->camera_m;
    } else {
      const auto pixel = to_.reference().project(place);
      if (!pixel) continue;
      out.x[i] = pixel->x;
      out.y[i] = pixel->y;
      camera_m[i] = to_.reference().position();
    }
    imaged |= 1U << i;
  }
  const std::uint32_t not_seen = imaged ? hidden(points, imaged, camera_m) : 0;
  for (int i = 0; i < kPacket; ++i)
    if (not_seen >> i & 1) out.x[i] = out.y[i] = std::numeric_limits<double>::quiet_NaN();
}

std::uint32_t Flow::hidden(const SurfacePoints& points, std::uint32_t asking, const Vec3 (&camera_m)[kPacket]) const {
  Rays rays;
  double distance_m[kPacket];
  const int some = std::countr_zero(asking);
  for (int i = 0; i < kPacket; ++i) {
    const int from = asking >> i & 1 ? i : some;
    const Vec3 way = points.position(from) - camera_m[from];
    distance_m[i] = way.norm();
    rays.set(i, camera_m[from], way / distance_m[i]);
    rays.valid[i] = from == i;
  }
  SurfacePoints met;
  if (job_.request.terrain)
    trace(job_.scene, rays, met);
  else
    for (int i = 0; i < kPacket; ++i) met.hit[i] = met.toward_moon[i] = false;
  ObjectLanes objects;
  const std::uint32_t on_objects = job_.objects.empty() ? 0 : job_.objects.intersect(rays, met, objects, false);
  std::uint32_t out = 0;
  for (int i = 0; i < kPacket; ++i) {
    if (!(asking >> i & 1)) continue;
    const bool object = on_objects >> i & 1;
    const double nearest_m = object ? objects.points.distance[i] : met.hit[i] ? met.distance[i] : distance_m[i];
    if (nearest_m < distance_m[i] - rounding_m(distance_m[i])) out |= 1U << i;
  }
  return out;
}

}  // namespace selenograph::engine
