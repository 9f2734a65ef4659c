#include "engine/visibility/zbuffer/raster_pass.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <mutex>

#include "dem/base/parallel.h"
#include "engine/frame/needs.h"
#include "engine/visibility/points/refine.h"
#include "engine/visibility/points/trace.h"
#include "engine/visibility/zbuffer/pixel_kernels.h"

namespace selenograph::engine {

// Sixteen pixels of a tile, from (x, y) of the image on; the first `inside` of them are in the tile.
struct RasterPass::Row {
  int x, y, inside;
  std::size_t first;  // index of the first pixel in the image
  const SubpixelSample& sample;
  const PixelRays& lens;
  const PacketShader& shader;
  float *radiance, *bases;  // outputs for the sixteen pixels; null: not requested, or the same for all pixels
};

// Pixels that the kernel would resolve but for rocks. Most rows have few of them: they go the long way sixteen at a
// time.
struct RasterPass::NearRocks {
  Rays rays;
  std::uint32_t triangle[kPacket];
  std::size_t pixel[kPacket];  // index in the image
  int count = 0;
};

RasterPass::RasterPass(const FrameJob& job, FrameWriter& writer, FrameScratch& scratch, StageTimes& times)
    : job_(job),
      request_(job.request),
      mesh_(*job.scene.raster),
      writer_(writer),
      scratch_(scratch),
      times_(times),
      tiling_(mesh_, job.views),
      rays_(job.views.reference()),
      shader_(job.request, job.views, job.scene.mesh, job.radiance, job.indirect) {
  if (!wants_light(request_)) return;
  if (request_.sun.angular_radius_deg > 0) {
    disc_.emplace(request_.sun, mesh_.anchor());
    shadows_.emplace(mesh_, *disc_);
  } else {
    shadows_.emplace(mesh_, request_.sun.direction);
    const Brdf* brdf = shader_.uniform_brdf();
    if (!brdf || !request_.camera.rectilinear() || !(job_.objects.empty() || job_.objects.are_only_rocks())) return;
    const int views = job.views.vary() ? job.views.height() : 1;
    for (int row = 0; row < views; ++row)
      row_terms_.emplace_back(job.views.of(row), mesh_.anchor(), shadows_->axes(), *brdf, shader_.irradiance_w_m2(),
                              shader_.base_radiance(), shader_.missing_albedo());
  }
}

// Draws each tile and resolves its pixels: refines the point, shades it as if nothing hid the Sun, and adds it to the
// samples of the shadow map.
void RasterPass::find_points(Pixels& pixels) {
  const SubpixelSample& sample = pixels.sample;
  const bool centre = sample.dx == 0 && sample.dy == 0;
  const PixelRays own_lens =
      tiling_.bends() && !centre ? PixelRays(request_.camera, sample.dx, sample.dy, job_.stop) : PixelRays();
  const PixelRays& lens = centre ? job_.centres : own_lens;
  tiling_.lay(sample.dx, sample.dy, lens, scratch_.boxes, scratch_.tiles);
  const auto size = static_cast<std::size_t>(request_.camera.width) * static_cast<std::size_t>(request_.camera.height);
  scratch_.samples.resize(scratch_.tiles.size());
  if (sample.weight > 0 && !sample.store) scratch_.radiance.assign(size, 0.F);
  scratch_.bases.clear();
  if (sample.weight > 0 && (shader_.bases_vary() || !job_.objects.empty()))
    scratch_.bases.assign(size, shader_.base_radiance());

  pixels.watch.lap_ms();  // restart the watch: the loop's time is shared out below
  std::mutex mutex;
  double draw_ms = 0, resolve_ms = 0;  // sum over threads
  in_parallel_pieces(scratch_.tiles.size(), 1, [&](std::size_t first, std::size_t past_last) {
    PixelCounts counts;
    double thread_draw_ms = 0, thread_resolve_ms = 0;
    const Pool<TileBuffer>::Lease buffer(scratch_.buffers);
    for (std::size_t i = first; i < past_last; ++i) {
      job_.stop.check();
      Stopwatch lap;
      tiling_.draw(scratch_.tiles[i], sample.dx, sample.dy, lens, scratch_.boxes, *buffer);
      thread_draw_ms += lap.lap_ms();
      resolve_tile(scratch_.tiles[i], *buffer, sample, lens, counts, scratch_.samples[i]);
      thread_resolve_ms += lap.lap_ms();
    }
    if (sample.count) writer_.merge(counts);
    const std::lock_guard lock(mutex);
    draw_ms += thread_draw_ms;
    resolve_ms += thread_resolve_ms;
  });
  // Distribute the wall-clock time of the loop by the work of all threads.
  const double tiles_ms = pixels.watch.lap_ms();
  const double work_ms = std::max(draw_ms + resolve_ms, 1e-9);
  times_.draw_ms += tiles_ms * draw_ms / work_ms;
  times_.resolve_ms += tiles_ms * resolve_ms / work_ms;
}

void RasterPass::resolve_tile(const ImageTile& tile, const TileBuffer& buffer, const SubpixelSample& sample,
                              const PixelRays& lens, PixelCounts& counts, LightSamples& samples) {
  const std::size_t capacity = static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height) + kPacket;
  samples.clear(capacity);
  if (disc_) samples.disc.clear(capacity, !job_.objects.empty());
  PacketShader::Sampler sampler = shader_.sampler(job_.stop);
  const auto row_at = [&](int x, int y) {
    const std::size_t first_pixel =
        static_cast<std::size_t>(tile.y0 + y) * static_cast<std::size_t>(request_.camera.width) +
        static_cast<std::size_t>(tile.x0 + x);
    return Row{tile.x0 + x,
               tile.y0 + y,
               std::min(kPacket, tile.width - x),
               first_pixel,
               sample,
               lens,
               shader_,
               sample.weight > 0 ? radiance_of(sample).data() + first_pixel : nullptr,
               scratch_.bases.empty() ? nullptr : scratch_.bases.data() + first_pixel};
  };
  NearRocks near_rocks;
  for (int y = 0; y < tile.height; ++y)
    for (int x = 0; x < tile.width; x += kPacket) {
      const std::uint32_t* triangles =
          &buffer.triangle[static_cast<std::size_t>(y) * static_cast<std::size_t>(tile.width) +
                           static_cast<std::size_t>(x)];
      resolve(row_at(x, y), triangles, near_rocks, counts, samples, sampler);
    }
  if (near_rocks.count > 0) resolve_near_rocks(near_rocks, row_at(0, 0), counts, samples, sampler);
  samples.bound();
}

void RasterPass::resolve(const Row& row, const std::uint32_t* triangles, NearRocks& near_rocks, PixelCounts& counts,
                         LightSamples& samples, PacketShader::Sampler& sampler) {
  const SubpixelSample& sample = row.sample;
  SurfacePoints points;
  take_triangles(triangles, row.inside, points);
  prefetch(triangles + kPacket);
  ResolvedRow by_kernel;
  RowPlaces places;
  std::uint32_t near = resolve_by_kernel(row, points, by_kernel, places);
  if ((by_kernel.resolved | near) == kAllLanes && !needs_points(row, points, near, counts)) {
    store_row(row, by_kernel, samples);
    for (; near != 0; near &= near - 1) {
      const int i = std::countr_zero(near), at = near_rocks.count++;
      near_rocks.rays.set(at, job_.views.reference().position(), {places.dx[i], places.dy[i], places.dz[i]});
      near_rocks.triangle[at] = triangles[i];
      near_rocks.pixel[at] = row.first + static_cast<std::size_t>(i);
      if (near_rocks.count == kPacket) resolve_near_rocks(near_rocks, row, counts, samples, sampler);
    }
    return;
  }
  Rays rays;
  const PixelRays* lens = tiling_.bends() ? &row.lens : nullptr;
  if (job_.views.vary())
    aim_rows(job_.views, PacketShape::row, row.x, row.y, sample.dx, sample.dy, lens, rays);
  else
    rays_.aim(PacketShape::row, row.x, row.y, sample.dx, sample.dy, lens, rays);
  Facets facets;
  TriangleId drawn[kPacket];
  std::memcpy(static_cast<void*>(drawn), points.triangle, sizeof drawn);
  refine(job_.scene.mesh, rays, points, facets, job_.views.vary() ? kMaxMissOfRows : kMaxMiss);
  // Resolve again by triangles that differ: a pixel must not depend on the triangles that float proposed for its row.
  if (by_kernel.resolved != kAllLanes && std::memcmp(drawn, points.triangle, sizeof drawn) != 0)
    resolve_by_kernel(row, points, by_kernel, places);
  store_row(row, by_kernel, samples);
  resolve_points(row, rays, points, facets, by_kernel, counts, samples, sampler);
}

std::uint32_t RasterPass::resolve_by_kernel(const Row& row, const SurfacePoints& points, ResolvedRow& out,
                                            RowPlaces& places) const {
  const SubpixelSample& sample = row.sample;
  const std::uint32_t hits = hit_bits(points);
  if (row_terms_.empty() || !sample.light || sample.weight == 0 || hits == 0) return 0;
  const RowTerms& terms = row_terms_[job_.views.vary() ? static_cast<std::size_t>(row.y) : 0];
  resolve_row(job_.scene.mesh, terms, row.x + sample.dx, row.y + sample.dy, points.triangle, out);
  out.resolved &= hits;
  std::uint32_t near = 0;
  if (!job_.objects.empty() && out.resolved != 0) {
    place_row(terms, row.x + sample.dx, row.y + sample.dy, out.light, places);
    near = out.resolved & job_.objects.near_rocks(places.dx, places.dy, places.dz, places.x, places.y, places.z);
    out.resolved &= ~near;
  }
  out.lit &= out.resolved;
  return near;
}

// A packet of collected pixels is at no one place of the image: it is resolved into arrays of its own, which are then
// copied.
void RasterPass::resolve_near_rocks(NearRocks& near_rocks, const Row& row, PixelCounts& counts, LightSamples& samples,
                                    PacketShader::Sampler& sampler) {
  for (int i = near_rocks.count; i < kPacket; ++i) {
    near_rocks.rays.set(i, near_rocks.rays.origin(0), near_rocks.rays.direction(0));
    near_rocks.rays.valid[i] = false;
  }
  SurfacePoints points;
  take_triangles(near_rocks.triangle, near_rocks.count, points);
  Facets facets;
  refine(job_.scene.mesh, near_rocks.rays, points, facets);
  alignas(64) float radiance[kPacket] = {};
  alignas(64) float bases[kPacket];
  std::fill_n(bases, kPacket, shader_.base_radiance());
  SubpixelSample sample = row.sample;
  sample.store = false;  // needs_points() has found nothing to store but radiance
  constexpr int kNoRow = -1;
  const std::size_t first_sample = samples.count;
  resolve_points({0, kNoRow, near_rocks.count, 0, sample, row.lens, row.shader, radiance, bases}, near_rocks.rays,
                 points, facets, {}, counts, samples, sampler);
  for (std::size_t k = first_sample; k < samples.count; ++k)
    samples.pixel[k] = static_cast<std::uint32_t>(near_rocks.pixel[samples.pixel[k]]);
  std::vector<float>& image = radiance_of(row.sample);
  for (std::size_t i = 0; i < static_cast<std::size_t>(near_rocks.count); ++i) {
    image[near_rocks.pixel[i]] = radiance[i];
    scratch_.bases[near_rocks.pixel[i]] = bases[i];
  }
  near_rocks.count = 0;
}

// Stores the radiance of the resolved pixels, and adds the lit ones to the samples of the shadow map.
void RasterPass::store_row(const Row& row, const ResolvedRow& resolved, LightSamples& samples) {
  if (resolved.resolved == kAllLanes)
    std::memcpy(row.radiance, resolved.radiance, sizeof resolved.radiance);
  else
    for (std::uint32_t lanes = resolved.resolved; lanes != 0; lanes &= lanes - 1) {
      const int i = std::countr_zero(lanes);
      row.radiance[i] = resolved.radiance[i];
    }
  const auto first = static_cast<std::uint32_t>(row.first);
  if (resolved.lit == kAllLanes) {
    samples.add_packet(resolved.light, first);
    return;
  }
  for (std::uint32_t lanes = resolved.lit; lanes != 0; lanes &= lanes - 1) {
    const auto i = static_cast<std::uint32_t>(std::countr_zero(lanes));
    samples.add(resolved.light.u[i], resolved.light.v[i], resolved.light.d[i], first + i);
  }
}

// Counts the pixels of a row whose light and radiance are known: all but those near rocks. Returns whether points are
// needed nevertheless: for ground truth, marks or sources that vary within a quad.
bool RasterPass::needs_points(const Row& row, const SurfacePoints& points, std::uint32_t near_rocks,
                              PixelCounts& counts) {
  const SubpixelSample& sample = row.sample;
  if (sample.store && writer_.wants_geometry_of(row.y)) return true;
  if (!sample.count) return false;
  PixelCounts uncounted;
  return writer_.marked(row.y, 1) ||
         (near_rocks != 0 && !writer_.account_all(points.triangle, near_rocks, uncounted)) ||
         !writer_.account_all(points.triangle, kAllLanes & ~near_rocks, counts);
}

namespace {

SurfacePoints with_hits(SurfacePoints points, std::uint32_t lanes) {
  for (int i = 0; i < kPacket; ++i) points.hit[i] = lanes >> i & 1;
  return points;
}

}  // namespace

// Resolves sixteen pixels whose terrain points are known: objects in front of the terrain, light and radiance of the
// lanes that the kernel has not resolved, then counts and ground truth of all lanes.
void RasterPass::resolve_points(const Row& row, Rays& rays, SurfacePoints& points, const Facets& facets,
                                const ResolvedRow& by_kernel, PixelCounts& counts, LightSamples& samples,
                                PacketShader::Sampler& sampler) {
  const SubpixelSample& sample = row.sample;
  if (!job_.objects.empty()) resolve_objects(row, rays, points, counts, samples);
  const std::uint32_t hits = hit_bits(points);
  const bool all_hit = hits == kAllLanes;
  if (sample.count && !all_hit) {
    find_missing(job_.scene, rays, points);
    counts.missing += static_cast<std::uint64_t>(std::count(points.toward_moon, points.toward_moon + kPacket, true));
  }
  if (!hits) return;
  if (sample.count && writer_.marked(row.y, 1)) mark(row, points);
  Shading shading;
  row.shader.shade(facets, points, rays, shading);
  alignas(64) float lit[kPacket] = {};
  alignas(64) float radiance[kPacket];
  alignas(64) float base[kPacket];
  const std::uint32_t unresolved = hits & ~by_kernel.resolved;
  const bool shades = sample.weight > 0 && unresolved != 0;
  if (sample.light && unresolved != 0)
    light_packet(unresolved == hits ? points : with_hits(points, unresolved), nullptr, row.first, shading, lit,
                 samples);
  if (shades) row.shader.radiances(points, shading, rays, lit, sampler, radiance, base, {row.y, PacketShape::row});
  const bool stores_bases = shades && row.shader.bases_vary();
  const bool is_counted =
      !sample.count || (writer_.out().source.empty() && writer_.account_all(points.triangle, hits, counts));
  const bool stores_geometry = sample.store && writer_.wants_geometry_of(row.y);
  if (stores_geometry && writer_.wants_albedo()) store_albedos(row, points, rays, sampler);
  if (unresolved == kAllLanes && is_counted && !stores_geometry && !stores_bases) {
    if (shades) std::memcpy(row.radiance, radiance, sizeof radiance);
    return;
  }
  for (int i = 0; i < kPacket; ++i) {
    if (!points.hit[i]) continue;
    const std::size_t pixel = row.first + static_cast<std::size_t>(i);
    if (unresolved >> i & 1) {
      if (shades) row.radiance[i] = radiance[i];
      if (stores_bases) row.bases[i] = base[i];
    } else if (by_kernel.lit >> i & 1)
      lit[i] = 1;  // for store_geometry(); light_packet() has not seen this lane
    if (!is_counted) writer_.account(points, i, pixel, counts);
    if (stores_geometry) writer_.store_geometry(points, i, rays.direction(i), shading, lit[i], pixel);
  }
}

[[gnu::noinline]] void RasterPass::store_albedos(const Row& row, const SurfacePoints& points, const Rays& rays,
                                                 PacketShader::Sampler& sampler) {
  alignas(64) double albedo[kPacket];
  float base[kPacket];
  row.shader.albedos(points, rays, sampler, albedo, base, {row.y, PacketShape::row});
  for (int i = 0; i < kPacket; ++i)
    if (points.hit[i]) writer_.store_albedo(albedo[i], row.first + static_cast<std::size_t>(i));
}

[[gnu::noinline]] void RasterPass::mark(const Row& row, const SurfacePoints& points) {
  for (int i = 0; i < kPacket; ++i)
    if (points.hit[i]) writer_.mark(row.x + i, row.y, points, i);
}

// Resolves the pixels of the row that see objects, and removes them from the terrain. Their points are samples of the
// shadow map, too. Neither this function nor shade_by_objects is inlined, so that frames without objects run the same
// code as before objects existed.
[[gnu::noinline]] void RasterPass::resolve_objects(const Row& row, Rays& rays, SurfacePoints& points,
                                                   PixelCounts& counts, LightSamples& samples) {
  const SubpixelSample& sample = row.sample;
  ObjectLanes lanes;
  if (job_.objects.intersect(rays, points, lanes) == 0) return;
  alignas(64) float lit[kPacket] = {};
  alignas(64) float radiance[kPacket];
  alignas(64) float base[kPacket];
  if (sample.light) light_packet(lanes.points, lanes.object, row.first, lanes.shading, lit, samples);
  if (sample.weight > 0) job_.objects.radiances(lanes, rays, lit, job_.indirect, radiance, base);
  for (int i = 0; i < kPacket; ++i) {
    if (!lanes.points.hit[i]) continue;
    const std::size_t at = row.first + static_cast<std::size_t>(i);
    if (sample.weight > 0) {
      row.radiance[i] = radiance[i];
      row.bases[i] = base[i];
    }
    if (sample.count) writer_.count_object(lanes, i, counts);
    if (sample.store) writer_.store_object(lanes, i, rays.direction(i), lit[i], at);
  }
}

// Prefetches the vertices of the triangles of the next pixels: a third of the time would be spent waiting for them.
// Every second pixel suffices, because neighbours share cache lines.
void RasterPass::prefetch(const std::uint32_t* triangles) const {
  for (int i = 0; i < kPacket; i += 2) {
    if (triangles[i] == kNoTriangle) continue;
    const TriangleId id(triangles[i]);
    const MeshBlock& block = job_.scene.mesh.blocks()[id.block()];
    const dem::Vertex* corner = block.vertices.data() + id.r() * block.side + id.c();
    __builtin_prefetch(corner);
    __builtin_prefetch(corner + block.side);
  }
}

// Sets `lit` to the share of the Sun that each point receives without terrain in between; lit points become samples of
// the shadow map. `own_object`: objects that the points are on; null on terrain.
void RasterPass::light_packet(const SurfacePoints& points, const std::uint16_t* own_object, std::size_t first_pixel,
                              Shading& shading, float* lit, LightSamples& samples) const {
  const auto first = static_cast<std::uint32_t>(first_pixel);
  if (disc_) {
    DiscLanes disc_lanes;
    const std::uint32_t facing = disc_->unoccluded(points, shading, disc_lanes, lit);
    if (facing == 0) return;
    DiscLight::FreeDirections free[kPacket];
    const std::uint32_t partly =
        job_.objects.empty() ? 0 : remove_object_shadows(points, own_object, facing, disc_lanes, shading, lit, free);
    add_samples(points, first, {&disc_lanes, partly, free}, all_lit_inside(points, lit), lit, samples);
    return;
  }
  alignas(64) std::int32_t facing[kPacket];  // 1: the facet faces a point Sun and no object blocks it
  facing_sun(points, request_.sun.direction, facing);
  if (!job_.objects.empty()) shade_by_objects(points, own_object, facing);
  lit_lanes(points, shading, facing, lit);
  add_samples(points, first, {}, all_lit_inside(points, lit), lit, samples);
}

// Reduces `lit` and the shading's cosine for the lanes of which objects hide part of the disc, and sets `free` to the
// directions that they leave free. Returns these lanes.
[[gnu::noinline]] std::uint32_t RasterPass::remove_object_shadows(const SurfacePoints& points,
                                                                  const std::uint16_t* own_object, std::uint32_t lanes,
                                                                  const DiscLanes& disc_lanes, Shading& shading,
                                                                  float* lit, DiscLight::FreeDirections* free) const {
  return disc_->remove_blocked(
      [&](std::uint32_t facing_lanes, const Vec3& toward) {
        return job_.objects.blocked(points, own_object, facing_lanes, toward);
      },
      lanes, disc_lanes, lit, shading.incident, free);
}

// Clears `facing` for the lanes whose sunlight an object blocks.
[[gnu::noinline]] void RasterPass::shade_by_objects(const SurfacePoints& points, const std::uint16_t* own_object,
                                                    std::int32_t* facing) const {
  std::uint32_t facing_lanes = 0;
  for (int i = 0; i < kPacket; ++i) facing_lanes |= points.hit[i] && facing[i] ? 1U << i : 0U;
  const std::uint32_t blocked = job_.objects.blocked(points, own_object, facing_lanes, request_.sun.direction);
  for (int i = 0; i < kPacket; ++i)
    if (blocked >> i & 1) facing[i] = 0;
}

// Adds the lit lanes as samples. `all_inside`: all lanes are lit and none is on an edge of its triangle. On an edge
// float cannot tell a ridge, where the far side lies below the point, from a crease, where it rises above it. There,
// test in double whether a point 1 cm up the ray to the Sun is buried, and place the sample at that point.
void RasterPass::add_samples(const SurfacePoints& p, std::uint32_t first_pixel, const DiscState& disc, bool all_inside,
                             float* lit, LightSamples& samples) const {
  constexpr float kStep_m = 0.01F;
  LightLanes lanes;
  shadows_->place(p, lanes);
  // Records the directions that objects leave free for lane i, if they hide any.
  const auto add_free = [&](std::size_t sample, std::size_t i) {
    if (!(disc.partly >> i & 1)) return;
    samples.disc.free[sample] = static_cast<std::uint32_t>(samples.disc.free_of_objects.size());
    samples.disc.free_of_objects.push_back(disc.free[i]);
  };
  if (all_inside && (!disc.disc_lanes || disc.disc_lanes->facing_all == kAllLanes)) {
    if (disc.disc_lanes) samples.disc.add_packet(samples.count, lanes, *disc.disc_lanes);
    for (std::size_t i = 0; disc.partly && i < kPacket; ++i) add_free(samples.count + i, i);
    samples.add_packet(lanes, first_pixel);
    return;
  }
  for (int i = 0; i < kPacket; ++i) {
    if (!(lit[i] > 0)) continue;
    float lift_m = 0;
    if (std::min({p.v[i], p.w[i], 1 - p.v[i] - p.w[i]}) <= kEdge) {
      lift_m = kStep_m;
      if (buried(job_.scene.mesh, p.triangle[i], p.position(i) + static_cast<double>(kStep_m) * shadows_->aim())) {
        lit[i] = 0;
        continue;
      }
    }
    if (disc.disc_lanes) {
      const auto lane = static_cast<std::size_t>(i);
      samples.disc.add(samples.count, lanes, *disc.disc_lanes, lane);
      add_free(samples.count, lane);
    }
    samples.add(lanes.u[i], lanes.v[i], lanes.d[i] + lift_m, first_pixel + static_cast<std::uint32_t>(i));
  }
}

// Casts the shadows, and reduces the stored products of the shadowed pixels.
void RasterPass::find_light(Pixels& pixels) {
  const SubpixelSample& sample = pixels.sample;
  if (!sample.light) return;
  shadows_->cast(scratch_.samples, scratch_.light, job_.stop);
  FrameProducts& out = writer_.out();
  if (!sample.store || (out.lit.empty() && out.irradiance.empty())) return;
  for_each_shaded([&](const PartlyLit& remaining) {
    const auto slot = writer_.slot(remaining.pixel);
    if (!slot) return;
    if (!out.lit.empty()) out.lit[*slot] *= remaining.share;
    if (!out.irradiance.empty()) out.irradiance[3 * *slot] *= remaining.cosine;
  });
}

// Calls visit(remaining light) for each pixel that loses light to terrain between it and the Sun. Parallel over bands.
template <typename Visit>
void RasterPass::for_each_shaded(const Visit& visit) const {
  in_parallel(scratch_.light.shadowed.size(), [&](std::size_t band) {
    for (const std::uint32_t at : scratch_.light.shadowed[band]) visit({at, 0, 0});
    if (!disc_) return;
    for (const PartlyLit& partly : scratch_.light.partly[band]) visit(partly);
  });
}

// Takes the direct light away from the radiance of shadowed pixels.
void RasterPass::find_radiance(Pixels& pixels) {
  const SubpixelSample& sample = pixels.sample;
  if (sample.weight > 0 && sample.light) shade(radiance_of(sample));
  times_.shadow_ms += pixels.watch.lap_ms();
}

// Reduces radiance to what shadows leave of it.
void RasterPass::shade(std::vector<float>& radiance) const {
  const float everywhere = shader_.base_radiance();
  for_each_shaded([&](const PartlyLit& remaining) {
    const float base = scratch_.bases.empty() ? everywhere : scratch_.bases[remaining.pixel];
    radiance[remaining.pixel] = base + (radiance[remaining.pixel] - base) * remaining.cosine;
  });
}

// Adds the sample to the radiance of the frame. Geometry products are written earlier, by find_points.
void RasterPass::write_products(Pixels& pixels) {
  const SubpixelSample& sample = pixels.sample;
  FrameProducts& out = writer_.out();
  if (sample.weight > 0 && job_.each) job_.each(sample, radiance_of(sample));
  if (sample.weight > 0 && !sample.store)
    in_parallel_pieces(scratch_.radiance.size(), 65536, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) out.radiance[i] += sample.weight * scratch_.radiance[i];
    });
}

namespace {

std::size_t bytes_of_tiles(const std::vector<ImageTile>& tiles, const std::vector<LightSamples>& samples) {
  std::size_t sum = bytes_of(tiles);
  for (const ImageTile& tile : tiles) sum += bytes_of(tile.strips);
  for (const LightSamples& s : samples) sum += s.bytes();
  return sum;
}

}  // namespace

std::size_t FrameScratch::bytes() const {
  return sizeof(FrameScratch) + bytes_of_tiles(tiles, samples) + bytes_of(boxes) + bytes_of(radiance) +
         bytes_of(bases) + light.bytes() + buffers.bytes();
}

}  // namespace selenograph::engine
