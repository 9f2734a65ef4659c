#include "engine/visibility/zbuffer/raster_pass.h"

#include <algorithm>
#include <cstring>
#include <mutex>

#include "dem/parallel.h"
#include "engine/frame/needs.h"
#include "engine/visibility/raytrace/trace.h"
#include "engine/visibility/refine.h"
#include "engine/visibility/zbuffer/pixel_kernels.h"

namespace selenograph::engine {

// Sixteen pixels of a tile from (x, y) of the image, `inside` of which are in the tile.
struct RasterPass::Row {
  int x, y, inside;
  std::size_t first;  // pixel
  const SubpixelSample& sample;
  const PixelRays& lens;
};

RasterPass::RasterPass(const FrameJob& job, FrameWriter& writer, FrameScratch& scratch, StageTimes& times)
    : job_(job),
      request_(job.request),
      mesh_(*job.scene.raster),
      writer_(writer),
      scratch_(scratch),
      times_(times),
      tiling_(mesh_, job.view),
      rays_(job.view),
      shader_(job.request, job.view, job.radiance) {
  if (!wants_light(request_)) return;
  shadows_.emplace(mesh_, request_.sun.direction);
  if (request_.sun.angular_radius_deg > 0) disc_.emplace(request_.sun);
}

// Draws each tile and resolves its pixels: refined, shaded as if nothing stood between them and the Sun, and placed
// under it.
void RasterPass::find_points(Pixels& pixels) {
  const SubpixelSample& sample = pixels.sample;
  const bool centre = sample.dx == 0 && sample.dy == 0;
  const PixelRays own =
      tiling_.bends() && !centre ? PixelRays(request_.camera, sample.dx, sample.dy, job_.stop) : PixelRays();
  const PixelRays& lens = centre ? job_.centres : own;
  tiling_.lay(sample.dx, sample.dy, lens, scratch_.boxes, scratch_.tiles);
  const auto size = static_cast<std::size_t>(request_.camera.width) * static_cast<std::size_t>(request_.camera.height);
  scratch_.samples.resize(scratch_.tiles.size());
  if (sample.weight > 0 && !sample.store) scratch_.radiance.assign(size, 0.F);
  scratch_.bases.clear();
  if (sample.weight > 0 && (shader_.mapped() || !job_.objects.empty()))
    scratch_.bases.assign(size, shader_.base_radiance());

  pixels.watch.lap_ms();
  std::mutex mutex;
  double draw_ms = 0, resolve_ms = 0;  // of all threads
  in_parallel_pieces(scratch_.tiles.size(), 1, [&](std::size_t first, std::size_t past_last) {
    PixelCounts counts;
    double draws_ms = 0, resolves_ms = 0;
    const Pool<TileBuffer>::Lease buffer(scratch_.buffers);
    for (std::size_t i = first; i < past_last; ++i) {
      job_.stop.check();
      Stopwatch lap;
      tiling_.draw(scratch_.tiles[i], sample.dx, sample.dy, lens, scratch_.boxes, *buffer);
      draws_ms += lap.lap_ms();
      resolve_tile(scratch_.tiles[i], *buffer, sample, lens, counts, scratch_.samples[i]);
      resolves_ms += lap.lap_ms();
    }
    if (sample.count) writer_.merge(counts);
    const std::lock_guard lock(mutex);
    draw_ms += draws_ms, resolve_ms += resolves_ms;
  });
  const double tiles_ms = pixels.watch.lap_ms(), work_ms = std::max(draw_ms + resolve_ms, 1e-9);
  times_.draw_ms += tiles_ms * draw_ms / work_ms, times_.resolve_ms += tiles_ms * resolve_ms / work_ms;
}

void RasterPass::resolve_tile(const ImageTile& tile, const TileBuffer& buffer, const SubpixelSample& sample,
                              const PixelRays& lens, PixelCounts& counts, LightSamples& samples) {
  samples.clear(static_cast<std::size_t>(tile.width) * static_cast<std::size_t>(tile.height) + kPacket,
                disc_.has_value());
  PacketShader::Sampler sampler = shader_.sampler(job_.stop);
  for (int y = 0; y < tile.height; ++y)
    for (int x = 0; x < tile.width; x += kPacket) {
      const std::size_t first =
          static_cast<std::size_t>(tile.y0 + y) * static_cast<std::size_t>(request_.camera.width) +
          static_cast<std::size_t>(tile.x0 + x);
      const std::uint32_t* triangles =
          &buffer.triangle[static_cast<std::size_t>(y) * static_cast<std::size_t>(tile.width) +
                           static_cast<std::size_t>(x)];
      resolve({tile.x0 + x, tile.y0 + y, std::min(kPacket, tile.width - x), first, sample, lens}, triangles, counts,
              samples, sampler);
    }
  samples.bound();
}

void RasterPass::resolve(const Row& row, const std::uint32_t* triangles, PixelCounts& counts, LightSamples& samples,
                         PacketShader::Sampler& sampler) {
  const SubpixelSample& sample = row.sample;
  Rays rays;
  rays_.aim(PacketShape::row, row.x, row.y, sample.dx, sample.dy, tiling_.bends() ? &row.lens : nullptr, rays);
  SurfacePoints points;
  take_triangles(triangles, row.inside, points);
  prefetch(triangles + kPacket);
  Facets facets;
  refine(job_.scene.mesh, rays, points, facets);
  if (!job_.objects.empty()) resolve_objects(row, rays, points, counts, samples);
  const std::uint32_t hits = hit_bits(points);
  const bool all = hits == kAllLanes;
  if (sample.count && !all) {
    find_missing(rays, points);
    counts.missing += static_cast<std::uint64_t>(std::count(points.toward_moon, points.toward_moon + kPacket, true));
  }
  if (!hits) return;
  Shading shading;
  shader_.shade(facets, points, rays, shading);
  alignas(64) float lit[kPacket] = {}, radiance[kPacket], base[kPacket];
  if (sample.light) place_under_sun(points, shading, nullptr, row.first, lit, samples);
  if (sample.weight > 0) shader_.radiances(points, shading, rays, lit, sampler, radiance, base);
  const bool bases = sample.weight > 0 && shader_.mapped();
  std::vector<float>& target = radiance_of(sample);
  std::uint32_t left = hits;  // to be accounted for
  if (writer_.out().source.empty()) left = sample.count ? writer_.account_all(points, hits, counts) : 0;
  const bool stores = sample.store && writer_.wants_geometry();
  if (all && left == 0 && !stores && !bases) {
    if (sample.weight > 0) std::memcpy(&target[row.first], radiance, sizeof radiance);
    return;
  }
  for (int i = 0; i < kPacket; ++i) {
    if (!points.hit[i]) continue;
    const std::size_t at = row.first + static_cast<std::size_t>(i);
    if (sample.weight > 0) target[at] = radiance[i];
    if (bases) scratch_.bases[at] = base[i];
    if (left >> i & 1 && sample.count) writer_.account(points, i, at, counts);
    if (stores) writer_.store_geometry(points, i, rays.direction(i), shading, lit[i], at);
  }
}

// Those of the row's pixels that see objects; they are no longer terrain's. Their points are samples of the shadow map
// like any others.
// Never inlined, nor is shade_by_objects: frames without objects have the same code as ever.
[[gnu::noinline]] void RasterPass::resolve_objects(const Row& row, Rays& rays, SurfacePoints& points,
                                                   PixelCounts& counts, LightSamples& samples) {
  const SubpixelSample& sample = row.sample;
  ObjectLanes lanes;
  if (job_.objects.meet(rays, points, lanes) == 0) return;
  alignas(64) float lit[kPacket] = {}, radiance[kPacket], base[kPacket];
  if (sample.light) place_under_sun(lanes.points, lanes.shading, lanes.object, row.first, lit, samples);
  if (sample.weight > 0) job_.objects.radiances(lanes, rays, lit, radiance, base);
  std::vector<float>& target = radiance_of(sample);
  for (int i = 0; i < kPacket; ++i) {
    if (!lanes.points.hit[i]) continue;
    const std::size_t at = row.first + static_cast<std::size_t>(i);
    if (sample.weight > 0) target[at] = radiance[i], scratch_.bases[at] = base[i];
    if (sample.count) ++counts.hit, ++counts.on_object;
    if (sample.store) writer_.store_object(lanes, i, rays.direction(i), lit[i], at);
  }
}

// Asks memory for what the next pixels' triangles are made of: a third of the time would go by waiting for it. Every
// second one will do, neighbours share cache lines.
void RasterPass::prefetch(const std::uint32_t* triangles) const {
  for (int i = 0; i < kPacket; i += 2) {
    if (triangles[i] == kNoTriangle) continue;
    const TriangleId id(triangles[i]);
    const MeshBlock& block = job_.scene.mesh.blocks()[id.block()];
    const dem::Vertex* corner = block.vertices.data() + id.r() * block.side + id.c();
    __builtin_prefetch(corner), __builtin_prefetch(corner + block.side);
  }
}

// Sets lit: 1 where a point faces the Sun, as far as it is alone with it; such points are samples of the shadow map.
// `own`: objects that the points are on; null on terrain.
void RasterPass::place_under_sun(const SurfacePoints& points, const Shading& shading, const std::uint16_t* own,
                                 std::size_t first_pixel, float* lit, LightSamples& samples) const {
  alignas(64) std::int32_t facing[kPacket];
  if (disc_)
    disc_->faced_by(points, facing);
  else
    facing_sun(points, request_.sun.direction, facing);
  if (!job_.objects.empty()) shade_by_objects(points, own, facing);
  const bool all_inside = lit_lanes(points, shading, facing, lit);
  add_samples(points, facing, static_cast<std::uint32_t>(first_pixel), lit, all_inside, samples);
}

// What an object blocks counts as not faced.
[[gnu::noinline]] void RasterPass::shade_by_objects(const SurfacePoints& points, const std::uint16_t* own,
                                                    std::int32_t* facing) const {
  const auto shade = [&](const Vec3& sun, int bit) {
    std::uint32_t asking = 0;
    for (int i = 0; i < kPacket; ++i) asking |= points.hit[i] && facing[i] >> bit & 1 ? 1U << i : 0U;
    const std::uint32_t blocked = job_.objects.blocked(points, own, asking, sun);
    for (int i = 0; i < kPacket; ++i)
      if (blocked >> i & 1) facing[i] &= ~static_cast<std::int32_t>(1U << bit);
  };
  if (!disc_) return shade(request_.sun.direction, 0);
  for (int k = 0; k < kDiscSamples; ++k) shade(disc_->directions()[static_cast<std::size_t>(k)], k);
}

// Samples of the lit lanes. `all_inside`: all are lit, none is on an edge of its triangle. There float can't tell a
// ridge, whose far side lies beneath the point, from a crease, where it rises above it: double looks whether the Sun's
// ray goes into the ground at once, and the sample is taken that little way up the ray.
void RasterPass::add_samples(const SurfacePoints& p, const std::int32_t* facing, std::uint32_t first_pixel, float* lit,
                             bool all_inside, LightSamples& samples) const {
  constexpr float kStep_m = 0.01F;
  LightLanes lanes;
  shadows_->place(p, lanes);
  if (all_inside) {
    if (disc_) samples.add_faces(facing);
    samples.add_all(lanes, first_pixel);
    return;
  }
  for (int i = 0; i < kPacket; ++i) {
    if (!(lit[i] > 0)) continue;
    float up = 0;
    if (std::min({p.v[i], p.w[i], 1 - p.v[i] - p.w[i]}) <= kEdge) {
      up = kStep_m;
      if (buried(job_.scene.mesh, p.triangle[i],
                 p.position(i) + static_cast<double>(kStep_m) * request_.sun.direction)) {
        lit[i] = 0;
        continue;
      }
    }
    if (disc_) samples.add_face(facing[i]);
    samples.add(lanes.u[i], lanes.v[i], lanes.d[i] + up, first_pixel + static_cast<std::uint32_t>(i));
  }
}

// Casts the shadows: for_shaded says of what.
void RasterPass::find_light(Pixels& pixels) {
  if (!pixels.sample.light) return;
  if (disc_)
    disc_->cast(mesh_, *shadows_, request_.camera.width, request_.camera.height, scratch_.samples, scratch_.light,
                scratch_.disc, job_.stop);
  else
    shadows_->cast(scratch_.samples, scratch_.light, job_.stop);
}

// work(pixel, how much of the Sun it sees) for the pixels whose points face the Sun but see only a part of it, or none.
// Parallel.
template <typename Work>
void RasterPass::for_shaded(const Work& work) const {
  if (!disc_)
    return in_parallel(scratch_.light.shadowed.size(), [&](std::size_t band) {
      for (const std::uint32_t at : scratch_.light.shadowed[band]) work(at, 0.F);
    });
  in_parallel(scratch_.samples.size(), [&](std::size_t tile) {
    const LightSamples& samples = scratch_.samples[tile];
    for (std::size_t k = 0; k < samples.count; ++k) {
      const std::uint32_t at = samples.pixel[k];
      work(at, SunDisc::lit_share(samples.faces[k], scratch_.disc.dark[at]));
    }
  });
}

void RasterPass::find_radiance(Pixels& pixels) {
  const SubpixelSample& sample = pixels.sample;
  if (sample.weight > 0 && sample.light) {
    std::vector<float>& radiance = radiance_of(sample);
    const float everywhere = shader_.base_radiance();
    const auto base_of = [&](std::uint32_t at) { return scratch_.bases.empty() ? everywhere : scratch_.bases[at]; };
    for_shaded(
        [&](std::uint32_t at, float share) { radiance[at] = base_of(at) + (radiance[at] - base_of(at)) * share; });
  }
  times_.shadow_ms += pixels.watch.lap_ms();
}

// Of geometry, what the points' places say is written when they are found.
void RasterPass::write_products(Pixels& pixels) {
  const SubpixelSample& sample = pixels.sample;
  FrameProducts& out = writer_.out();
  if (sample.light && sample.store && !out.lit.empty())
    for_shaded([&](std::uint32_t at, float share) { out.lit[at] = share; });
  if (sample.weight > 0 && !sample.store)
    in_parallel_pieces(scratch_.radiance.size(), 65536, [&](std::size_t first, std::size_t past_last) {
      for (std::size_t i = first; i < past_last; ++i) out.radiance[i] += sample.weight * scratch_.radiance[i];
    });
}

std::size_t FrameScratch::bytes() const {
  std::size_t sum = sizeof(FrameScratch) + bytes_of(boxes) + bytes_of(tiles) + bytes_of(radiance) + bytes_of(bases) +
                    light.bytes() + disc.bytes() + buffers.bytes();
  for (const ImageTile& tile : tiles) sum += bytes_of(tile.strips);
  for (const LightSamples& s : samples) sum += s.bytes();
  return sum;
}

}  // namespace selenograph::engine
