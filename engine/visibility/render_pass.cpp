#include "engine/visibility/render_pass.h"

#include <algorithm>
#include <array>
#include <numbers>

#include "dem/error.h"
#include "dem/parallel.h"
#include "engine/visibility/frame_sources.h"
#include "engine/visibility/objects_in_frame.h"
#include "engine/visibility/pixel_store.h"
#include "engine/visibility/raytrace/trace.h"
#include "engine/visibility/zbuffer/raster_pass.h"

namespace selenograph::engine {
namespace {

constexpr int kTile = 32;  // pixels; a tile is one task
constexpr double kDegrees = 180 / std::numbers::pi;

class RayPass {
 public:
  RayPass(const Scene& scene, PixelStore& store, const ObjectsInFrame& objects)
      : scene_(scene), store_(store), objects_(objects), request_(store.request()) {
    if (request_.sun.angular_radius_deg > 0) disc_ = disc_directions(request_.sun);
  }

  void run(const StopToken& stop) {
    const int across = (request_.camera.width + kTile - 1) / kTile,
              along = (request_.camera.height + kTile - 1) / kTile;
    const std::vector<Layer> all = store_.layers();
    in_parallel_pieces(static_cast<std::size_t>(across * along), 1, [&](std::size_t first, std::size_t past_last) {
      PassCounts counts;
      PixelStore::Sampler sampler = store_.sampler();
      for (int tile = static_cast<int>(first); tile < static_cast<int>(past_last); ++tile) {
        stop.check();
        render_tile(tile % across * kTile, tile / across * kTile, all, counts, sampler);
      }
      store_.merge(counts);
    });
  }

 private:
  void render_tile(int x0, int y0, const std::vector<Layer>& layers, PassCounts& counts, PixelStore::Sampler& sampler) {
    for (int y = y0; y < std::min(y0 + kTile, request_.camera.height); y += kPacketSide)
      for (int x = x0; x < std::min(x0 + kTile, request_.camera.width); x += kPacketSide)
        for (const Layer& layer : layers) render_packet(x, y, layer, layer.count ? &counts : nullptr, sampler);
  }

  // 4 x 4 pixels from (x, y).
  void render_packet(int x, int y, const Layer& layer, PassCounts* counts, PixelStore::Sampler& sampler) {
    if (layer.weight > 0)  // memory fetches the rows while rays are traced
      for (int row = y; row < std::min(y + kPacketSide, request_.camera.height); ++row)
        __builtin_prefetch(
            &store_.out().radiance[static_cast<std::size_t>(row) * static_cast<std::size_t>(request_.camera.width) +
                                   static_cast<std::size_t>(x)],
            1);
    Rays rays;
    const bool centre = layer.dx == 0 && layer.dy == 0 && !store_.centres().x.empty();
    store_.aim(Shape::square, x, y, layer, centre ? &store_.centres() : nullptr, rays);
    SurfacePoints points;
    Facets facets;
    trace(scene_, rays, points, facets);
    if (!objects_.empty()) render_objects(x, y, layer, rays, points, counts);
    if (std::find(points.hit, points.hit + kPacket, true) == points.hit + kPacket) {
      if (counts && request_.terrain)
        counts->missing +=
            static_cast<std::uint64_t>(std::count(points.toward_moon, points.toward_moon + kPacket, true));
      return;
    }
    Shading shading;
    store_.shade(facets, points, rays, shading);
    float lit[kPacket] = {}, radiance[kPacket], base[kPacket];
    if (layer.light) light(points, shading, nullptr, lit);
    if (layer.weight > 0) store_.radiances(points, shading, rays, lit, sampler, radiance, base);
    for (int i = 0; i < kPacket; ++i) {
      if (counts && points.toward_moon[i]) ++counts->missing;
      if (!points.hit[i]) continue;
      const std::size_t at =
          static_cast<std::size_t>(y + i / kPacketSide) * static_cast<std::size_t>(request_.camera.width) +
          static_cast<std::size_t>(x + i % kPacketSide);
      if (layer.weight > 0) store_.out().radiance[at] += layer.weight * radiance[i];
      if (counts || layer.store) store_.account(points, i, at, counts);
      if (layer.store && store_.wants_geometry())
        store_.store_geometry(points, i, rays.direction(i), shading, lit[i], at);
    }
  }

  // The packet's pixels that see objects; those are no longer terrain's.
  [[gnu::noinline]] void render_objects(int x, int y, const Layer& layer, Rays& rays, SurfacePoints& points,
                                        PassCounts* counts) {
    ObjectLanes lanes;
    if (objects_.meet(rays, points, lanes) == 0) return;
    float lit[kPacket] = {};
    if (layer.light) light(lanes.points, lanes.shading, lanes.object, lit);
    store_.store_objects(objects_, lanes, rays, lit, Shape::square, x, y, layer,
                         {store_.out().radiance, layer.weight, nullptr}, counts);
  }

  // `own`: objects that the points are on; null on terrain.
  void light(const SurfacePoints& points, const Shading& shading, const std::uint16_t* own, float* lit) const {
    bool wanted[kPacket];
    for (int i = 0; i < kPacket; ++i) wanted[i] = points.hit[i] && shading.mu0[i] > 0;
    const auto toward = [&](const Vec3& sun, float* out) { light_from(points, wanted, own, sun, out); };
    if (request_.sun.angular_radius_deg > 0)
      mean_over_disc(disc_, toward, lit);
    else
      toward(request_.sun.direction, lit);
  }

  void light_from(const SurfacePoints& points, const bool* wanted, const std::uint16_t* own, const Vec3& sun,
                  float* lit) const {
    if (request_.terrain)
      sunlit(scene_, points, wanted, sun, lit);
    else
      for (int i = 0; i < kPacket; ++i) lit[i] = wanted[i] && points.facing(i).dot(sun) > 0 ? 1.F : 0.F;
    if (objects_.empty()) return;
    std::uint32_t asking = 0;
    for (int i = 0; i < kPacket; ++i) asking |= lit[i] > 0 ? 1U << i : 0U;
    const std::uint32_t blocked = objects_.blocked(points, own, asking, sun);
    for (int i = 0; i < kPacket; ++i)
      if (blocked >> i & 1) lit[i] = 0;
  }

  const Scene& scene_;
  PixelStore& store_;
  const ObjectsInFrame& objects_;
  const FrameRequest& request_;
  std::array<Vec3, kDiscSamples> disc_;  // of a Sun that has one
};

}  // namespace

PassCounts render_pixels(const Scene& scene, const View& view, const FrameRequest& request,
                         const RadianceTerms& radiance, const PixelRays& rays, const ObjectsInFrame& objects,
                         FrameSources& sources, const StopToken& stop, FrameScratch& scratch, FrameProducts& products) {
  PixelStore store(scene.mesh, view, request, radiance, rays, sources, products);
  if (scene.raster)
    draw_pixels(*scene.raster, store, objects, stop, scratch);
  else
    RayPass(scene, store, objects).run(stop);
  return store.take_total();
}

}  // namespace selenograph::engine
