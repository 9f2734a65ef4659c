#include "engine/visibility/raytrace/ray_pass.h"

#include "engine/frame/needs.h"

namespace selenograph::engine {

RayPass::RayPass(const FrameJob& job, FrameWriter& writer)
    : job_(job),
      request_(job.request),
      writer_(writer),
      rays_(job.views.reference()),
      shader_(job.request, job.views, job.scene.mesh, job.radiance, job.indirect) {
  if (request_.sun.angular_radius_deg > 0) disc_.emplace(request_.sun, job.scene.anchor);
  if (job.flow_to && wants_flow(request_)) flow_.emplace(*job.flow_to, job);
}

std::size_t RayPass::pixel_of(const Packet& p, int i) const {
  return static_cast<std::size_t>(p.y + i / kPacketSide) * static_cast<std::size_t>(request_.camera.width) +
         static_cast<std::size_t>(p.x + i % kPacketSide);
}

// Sets the rays of a packet: through the views of its rows, if they differ, else from one camera.
void RayPass::aim(Packet& p) const {
  if (p.sample.weight > 0)  // prefetch the rows of the output while rays are traced
    for (int row = p.y; row < std::min(p.y + kPacketSide, request_.camera.height); ++row)
      __builtin_prefetch(
          &writer_.out().radiance[static_cast<std::size_t>(row) * static_cast<std::size_t>(request_.camera.width) +
                                  static_cast<std::size_t>(p.x)],
          1);
  const bool centre = p.sample.dx == 0 && p.sample.dy == 0 && !job_.centres.x.empty();
  const PixelRays* lens = centre ? &job_.centres : nullptr;
  if (job_.views.vary())
    aim_rows(job_.views, PacketShape::square, p.x, p.y, p.sample.dx, p.sample.dy, lens, p.rays);
  else
    rays_.aim(PacketShape::square, p.x, p.y, p.sample.dx, p.sample.dy, lens, p.rays);
}

void RayPass::intersect_rays(Packet& p) const {
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

// Finds the pixels that see objects, and removes them from the terrain.
[[gnu::noinline]] void RayPass::find_objects(Packet& p) const {
  p.on_object = job_.objects.intersect(p.rays, p.points, p.objects);
}

void RayPass::find_light(Packet& p) const {
  std::fill_n(p.lit, kPacket, 0.F);
  if (p.on_terrain && p.sample.light) light(p.points, nullptr, p.shading, p.lit);
  if (!p.on_object) return;
  std::fill_n(p.object_lit, kPacket, 0.F);
  if (p.sample.light) light(p.objects.points, p.objects.object, p.objects.shading, p.object_lit);
}

// Sets the light of sixteen points. `own_object`: objects that the points are on; null on terrain.
void RayPass::light(const SurfacePoints& points, const std::uint16_t* own_object, Shading& shading, float* lit) const {
  const auto blocked = [&](std::uint32_t requested, const Vec3& toward) {
    const std::uint32_t dark = request_.terrain ? shaded(job_.scene, points, requested, toward) : 0;
    return dark | (job_.objects.empty() ? 0 : job_.objects.blocked(points, own_object, requested & ~dark, toward));
  };
  if (disc_) {
    DiscLanes disc_lanes;
    const std::uint32_t lit_lanes = disc_->unoccluded(points, shading, disc_lanes, lit);
    disc_->remove_blocked(blocked, lit_lanes, disc_lanes, lit, shading.incident);
    return;
  }
  std::uint32_t requested = 0;
  for (int i = 0; i < kPacket; ++i)
    if (points.hit[i] && shading.mu0[i] > 0 && points.facet_normal(i).dot(request_.sun.direction) > 0)
      requested |= 1U << i;
  const std::uint32_t dark = blocked(requested, request_.sun.direction);
  for (int i = 0; i < kPacket; ++i) lit[i] = requested & ~dark & 1U << i ? 1.F : 0.F;
}

void RayPass::find_radiance(Packet& p) const {
  if (!(p.sample.weight > 0)) return;
  float base[kPacket];  // radiance without the Sun: not needed, because the light is known already
  if (p.on_terrain) shader_.radiances(p.points, p.shading, p.rays, p.lit, p.task.sampler, p.radiance, base, {p.y});
  if (p.on_object) job_.objects.radiances(p.objects, p.rays, p.object_lit, job_.indirect, p.object_radiance, base);
}

void RayPass::write_products(Packet& p) const {
  if (flow_ && p.sample.store) write_flow(p);
  if (p.on_object) write_objects(p);
  if (!p.on_terrain) return;
  const bool marked = p.sample.count && writer_.marked(p.y, kPacketSide);
  alignas(64) double albedo[kPacket];
  const bool stores_albedo = p.sample.store && writer_.wants_albedo();
  if (stores_albedo) {
    float base[kPacket];
    shader_.albedos(p.points, p.rays, p.task.sampler, albedo, base, {p.y});
  }
  for (int i = 0; i < kPacket; ++i) {
    if (!p.points.hit[i]) continue;
    const std::size_t pixel = pixel_of(p, i);
    if (marked) writer_.mark(p.x + i % kPacketSide, p.y + i / kPacketSide, p.points, i);
    if (p.sample.weight > 0) add_radiance(pixel, p.sample.weight, p.radiance[i]);
    if (p.sample.count) writer_.account(p.points, i, pixel, p.task.counts);
    if (p.sample.store && writer_.wants_geometry())
      writer_.store_geometry(p.points, i, p.rays.direction(i), p.shading, p.lit[i], pixel);
    if (stores_albedo) writer_.store_albedo(albedo[i], pixel);
  }
}

[[gnu::noinline]] void RayPass::write_flow(const Packet& p) const {
  Flow::PixelPositions positions;
  const auto write = [&](const SurfacePoints& points, std::uint32_t lanes) {
    flow_->find(points, lanes, positions);
    for (int i = 0; i < kPacket; ++i) {
      const int x = p.x + i % kPacketSide, y = p.y + i / kPacketSide;
      if (lanes >> i & 1) writer_.store_flow(positions.x[i] - x, positions.y[i] - y, pixel_of(p, i));
    }
  };
  if (p.on_terrain) write(p.points, p.on_terrain);
  if (p.on_object) write(p.objects.points, p.on_object);
}

[[gnu::noinline]] void RayPass::write_objects(Packet& p) const {
  for (int i = 0; i < kPacket; ++i) {
    if (!p.objects.points.hit[i]) continue;
    const std::size_t pixel = pixel_of(p, i);
    if (p.sample.weight > 0) add_radiance(pixel, p.sample.weight, p.object_radiance[i]);
    if (p.sample.count) writer_.count_object(p.objects, i, p.task.counts);
    if (p.sample.store) writer_.store_object(p.objects, i, p.rays.direction(i), p.object_lit[i], pixel);
  }
}

}  // namespace selenograph::engine
