#include "engine/visibility/raytrace/ray_pass.h"

namespace selenograph::engine {

RayPass::RayPass(const FrameJob& job, FrameWriter& writer)
    : job_(job), request_(job.request), writer_(writer), rays_(job.view), shader_(job.request, job.view, job.radiance) {
  if (request_.sun.angular_radius_deg > 0) disc_ = disc_directions(request_.sun);
}

std::size_t RayPass::pixel_of(const Packet& p, int i) const {
  return static_cast<std::size_t>(p.y + i / kPacketSide) * static_cast<std::size_t>(request_.camera.width) +
         static_cast<std::size_t>(p.x + i % kPacketSide);
}

void RayPass::find_points(Packet& p) const {
  if (p.sample.weight > 0)  // memory fetches the rows while rays are traced
    for (int row = p.y; row < std::min(p.y + kPacketSide, request_.camera.height); ++row)
      __builtin_prefetch(
          &writer_.out().radiance[static_cast<std::size_t>(row) * static_cast<std::size_t>(request_.camera.width) +
                                  static_cast<std::size_t>(p.x)],
          1);
  const bool centre = p.sample.dx == 0 && p.sample.dy == 0 && !job_.centres.x.empty();
  rays_.aim(PacketShape::square, p.x, p.y, p.sample.dx, p.sample.dy, centre ? &job_.centres : nullptr, p.rays);
  Facets facets;
  trace(job_.scene, p.rays, p.points, facets);
  p.on_object = 0;
  if (!job_.objects.empty()) find_objects(p);
  p.on_terrain = hit_bits(p.points);
  if (p.sample.count && request_.terrain)
    p.task.counts.missing +=
        static_cast<std::uint64_t>(std::count(p.points.toward_moon, p.points.toward_moon + kPacket, true));
  if (p.on_terrain) shader_.shade(facets, p.points, p.rays, p.shading);
}

// The packet's pixels that see objects; those are no longer terrain's.
[[gnu::noinline]] void RayPass::find_objects(Packet& p) const {
  p.on_object = job_.objects.meet(p.rays, p.points, p.objects);
}

void RayPass::find_light(Packet& p) const {
  std::fill_n(p.lit, kPacket, 0.F);
  if (p.on_terrain && p.sample.light) light(p.points, p.shading, nullptr, p.lit);
  if (!p.on_object) return;
  std::fill_n(p.object_lit, kPacket, 0.F);
  if (p.sample.light) light(p.objects.points, p.objects.shading, p.objects.object, p.object_lit);
}

// `own`: objects that the points are on; null on terrain.
void RayPass::light(const SurfacePoints& points, const Shading& shading, const std::uint16_t* own, float* lit) const {
  bool wanted[kPacket];
  for (int i = 0; i < kPacket; ++i) wanted[i] = points.hit[i] && shading.mu0[i] > 0;
  const auto toward = [&](const Vec3& sun, float* out) { light_from(points, wanted, own, sun, out); };
  if (request_.sun.angular_radius_deg > 0)
    mean_over_disc(disc_, toward, lit);
  else
    toward(request_.sun.direction, lit);
}

void RayPass::light_from(const SurfacePoints& points, const bool* wanted, const std::uint16_t* own, const Vec3& sun,
                         float* lit) const {
  if (request_.terrain)
    sunlit(job_.scene, points, wanted, sun, lit);
  else
    for (int i = 0; i < kPacket; ++i) lit[i] = wanted[i] && points.facet_normal(i).dot(sun) > 0 ? 1.F : 0.F;
  if (job_.objects.empty()) return;
  std::uint32_t asking = 0;
  for (int i = 0; i < kPacket; ++i) asking |= lit[i] > 0 ? 1U << i : 0U;
  const std::uint32_t blocked = job_.objects.blocked(points, own, asking, sun);
  for (int i = 0; i < kPacket; ++i)
    if (blocked >> i & 1) lit[i] = 0;
}

void RayPass::find_radiance(Packet& p) const {
  if (!(p.sample.weight > 0)) return;
  float base[kPacket];  // what is left without the Sun is of no use here: its light is known
  if (p.on_terrain) shader_.radiances(p.points, p.shading, p.rays, p.lit, p.task.sampler, p.radiance, base);
  if (p.on_object) job_.objects.radiances(p.objects, p.rays, p.object_lit, p.object_radiance, base);
}

void RayPass::write_products(Packet& p) const {
  if (p.on_object) write_objects(p);
  if (!p.on_terrain) return;
  for (int i = 0; i < kPacket; ++i) {
    if (!p.points.hit[i]) continue;
    const std::size_t at = pixel_of(p, i);
    if (p.sample.weight > 0) writer_.out().radiance[at] += p.sample.weight * p.radiance[i];
    if (p.sample.count) writer_.account(p.points, i, at, p.task.counts);
    if (p.sample.store && writer_.wants_geometry())
      writer_.store_geometry(p.points, i, p.rays.direction(i), p.shading, p.lit[i], at);
  }
}

[[gnu::noinline]] void RayPass::write_objects(Packet& p) const {
  for (int i = 0; i < kPacket; ++i) {
    if (!p.objects.points.hit[i]) continue;
    const std::size_t at = pixel_of(p, i);
    if (p.sample.weight > 0) writer_.out().radiance[at] += p.sample.weight * p.object_radiance[i];
    if (p.sample.count) ++p.task.counts.hit, ++p.task.counts.on_object;
    if (p.sample.store) writer_.store_object(p.objects, i, p.rays.direction(i), p.object_lit[i], at);
  }
}

}  // namespace selenograph::engine
