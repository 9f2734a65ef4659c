#include "engine/visibility/image/frame_writer.h"

#include <algorithm>
#include <cmath>

#include "engine/frame/needs.h"
#include "engine/support/assign.h"
#include "engine/visibility/points/facets.h"

namespace selenograph::engine {
namespace {

constexpr std::uint16_t kNoGround = 65535;  // pixels of `detail` without terrain

struct SourceAt {
  dem::SourceIndex index;  // dem::kNoSource if none
  bool filled, blended;
};

// Returns the tile of the nearest vertex; filled or blended if any vertex of the triangle is.
SourceAt source_at(const Mesh& mesh, const SurfacePoints& p, int lane) {
  const TriangleId& t = p.triangle[lane];
  const dem::Block& block = *mesh.blocks()[t.block()].posts;
  if (const dem::SourceMark mark = block.sources[0]; block.sources.size() == 1)
    return {dem::source_of(mark), dem::is_filled(mark), dem::is_blended(mark)};
  const dem::QuadVertices q = t.vertices();
  const double weights[3] = {1 - p.v[lane] - p.w[lane], p.v[lane], p.w[lane]};
  SourceAt nearest{dem::kNoSource, false, false};
  double max_weight = -1;
  for (int i = 0; i < 3; ++i) {
    const dem::SourceMark mark = block.source(q.r[i], q.c[i]);
    nearest.filled |= dem::is_filled(mark);
    nearest.blended |= dem::is_blended(mark);
    if (weights[i] > max_weight) {
      max_weight = weights[i];
      nearest.index = dem::source_of(mark);
    }
  }
  return nearest;
}

// Returns what the nearest vertex shows: DEM, crater, relief or rock.
dem::Ground ground_at(const Mesh& mesh, const SurfacePoints& p, int lane) {
  const TriangleId& t = p.triangle[lane];
  const dem::QuadVertices q = t.vertices();
  const double weights[3] = {1 - p.v[lane] - p.w[lane], p.v[lane], p.w[lane]};
  const auto i = std::max_element(weights, weights + 3) - weights;
  return mesh.blocks()[t.block()].posts->shown(q.r[i], q.c[i]);
}

double angle_deg(double cosine) { return std::acos(std::clamp(cosine, -1.0, 1.0)) * kDegreesPerRadian; }

}  // namespace

void allocate_products(FrameProducts& out, ProductSet requested, std::size_t pixels, std::size_t n,
                       const StopToken& stop) {
  const auto allocate = [&](auto& array, bool is_requested, std::size_t size, auto value) {
    if (is_requested) assign(array, size, value, stop);
  };
  allocate(out.radiance, requested & (kRadiance | kImage), pixels, 0.F);
  allocate(out.depth, requested & kDepth, n, kNaN64);
  allocate(out.range, requested & kRange, n, kNaN64);
  allocate(out.position, requested & kPosition, 3 * n, kNaN64);
  allocate(out.geodetic, requested & kGeodetic, 3 * n, kNaN64);
  allocate(out.normal, requested & kNormal, 3 * n, kNaN32);
  allocate(out.angles, requested & kAngles, 3 * n, kNaN32);
  allocate(out.lit, requested & kLit, n, kNaN32);
  allocate(out.irradiance, requested & kIrradiance, 3 * n, kNaN32);
  allocate(out.flow, requested & kFlow, 2 * n, kNaN64);
  allocate(out.gsd, requested & kGsd, n, kNaN32);
  allocate(out.source, requested & kSource, n, FrameSources::kNone);
  allocate(out.object_id, requested & kObjectId, n, kNoObject);
  allocate(out.detail, requested & kDetail, n, kNoGround);
  allocate(out.albedo, requested & kAlbedo, n, kNaN32);
  allocate(out.rock, requested & kRock, n, kNoObject);
  allocate(out.height, requested & kHeight, n, kNaN64);
  allocate(out.slope, requested & kSlope, n, kNaN32);
  allocate(out.rock_height, requested & kRockHeight, n, kNaN32);
}

FrameWriter::FrameWriter(const FrameRequest& request, const RowViews& views, const Mesh& mesh,
                         std::size_t catalogue_size, FrameProducts& out, const StopToken& stop)
    : request_(request),
      views_(views),
      mesh_(mesh),
      out_(out),
      wants_geometry_(engine::wants_geometry(request)),
      sources_(catalogue_size) {
  const std::size_t pixels =
      static_cast<std::size_t>(request.camera.width) * static_cast<std::size_t>(request.camera.height);
  allocate_products(out, request.products, pixels, request.truth ? request.truth->size() : pixels, stop);
}

// Counts all lanes at once, by the source of their blocks; returns false, without counting, if a lane hits a quad with
// several sources.
bool FrameWriter::account_all(const TriangleId triangles[kPacket], std::uint32_t hits, PixelCounts& counts) {
  const auto add = [&](const MeshBlock& block, std::uint64_t lanes) {
    counts.hit += lanes;
    if (dem::is_filled(block.source)) counts.filled += lanes;
    if (dem::is_blended(block.source)) counts.blended += lanes;
    if (const dem::SourceIndex index = dem::source_of(block.source); index != dem::kNoSource) sources_.number(index);
  };
  // Handle packets in one block of one source separately: this is the common case.
  const MeshBlock& first = mesh_.blocks()[triangles[0].block()];
  if (hits == kAllLanes && first.mixed.empty() && in_one_block(triangles)) {
    add(first, kPacket);
    return true;
  }
  for (int i = 0; i < kPacket; ++i) {
    const TriangleId id = triangles[i];
    if (!(hits >> i & 1)) continue;
    const std::vector<std::uint64_t>& mixed = mesh_.blocks()[id.block()].mixed;
    if (!mixed.empty() && mixed[static_cast<std::size_t>(id.r())] >> id.c() & 1) return false;
  }
  for (int i = 0, next = 0; i < kPacket; i = next) {
    const std::uint32_t block = triangles[i].block();
    std::uint64_t lanes = 0;  // of the run of pixels that see this block
    for (next = i; next < kPacket && triangles[next].block() == block; ++next) lanes += hits >> next & 1;
    if (lanes > 0) add(mesh_.blocks()[block], lanes);
  }
  return true;
}

void FrameWriter::account(const SurfacePoints& points, int i, std::size_t pixel, PixelCounts& counts) {
  const SourceAt source = source_at(mesh_, points, i);
  if (source.index != dem::kNoSource) {
    const auto slot_index = out_.source.empty() ? std::nullopt : slot(pixel);
    if (slot_index)
      out_.source[*slot_index] = sources_.product_number(source.index);
    else
      sources_.number(source.index);
  }
  ++counts.hit;
  counts.filled += source.filled;
  counts.blended += source.blended;
}

void FrameWriter::store_geometry(const SurfacePoints& p, int i, const Vec3& direction, const Shading& shading,
                                 float lit, std::size_t pixel) const {
  const auto slot_index = slot(pixel);
  if (!slot_index) return;
  const auto spacing_m = static_cast<float>(dem::post_spacing_m(mesh_.blocks()[p.triangle[i].block()].posts->id.level));
  if (!out_.detail.empty()) out_.detail[*slot_index] = static_cast<std::uint16_t>(ground_at(mesh_, p, i));
  store_point(p, i, direction, shading, lit, spacing_m, pixel, *slot_index);
  if (!out_.irradiance.empty())
    store_irradiance(light_.indirect ? light_.indirect->irradiance(p, i, shading.normal(i)) : Irradiance(),
                     shading.incident[i], lit, *slot_index);
}

// Writes the ground truth of a pixel that sees an object, a rock or the soil against a rock; soil counts as relief.
void FrameWriter::store_object(const ObjectLanes& lanes, int i, const Vec3& direction, float lit,
                               std::size_t pixel) const {
  if (!wants_geometry_) return;
  const auto slot_index = slot(pixel);
  if (!slot_index) return;
  const bool on_rock = is_rock(lanes.object[i]);
  const bool shows_rock = on_rock && !lanes.on_soil[i];
  if (!out_.object_id.empty() && !on_rock) out_.object_id[*slot_index] = lanes.object[i];
  if (!out_.rock.empty() && shows_rock)
    out_.rock[*slot_index] = static_cast<std::uint16_t>(lanes.object[i] - request_.objects.size());
  if (!out_.detail.empty() && on_rock)
    out_.detail[*slot_index] = static_cast<std::uint16_t>(shows_rock ? dem::Ground::rock : dem::Ground::relief);
  store_point(lanes.points, i, direction, lanes.shading, lit, kNaN32, pixel, *slot_index);
  if (!out_.irradiance.empty())
    store_irradiance(
        light_.indirect
            ? light_.indirect->on_objects(lanes.points.position(i), lanes.object[i]).on(lanes.shading.normal(i))
            : Irradiance(),
        lanes.shading.incident[i], lit, *slot_index);
}

void FrameWriter::store_point(const SurfacePoints& p, int i, const Vec3& direction, const Shading& shading, float lit,
                              float spacing_m, std::size_t pixel, std::size_t slot_index) const {
  const double length = direction.norm();
  const Vec3 position = p.position(i), normal = shading.normal(i);
  if (!out_.depth.empty()) out_.depth[slot_index] = views_.of_pixel(pixel).depth(direction, p.distance[i]);
  if (!out_.range.empty()) out_.range[slot_index] = p.distance[i] * length;
  if (!out_.position.empty()) std::copy_n(position.data(), 3, &out_.position[3 * slot_index]);
  if (!out_.geodetic.empty()) {
    const Geographic g = to_geographic(position);
    out_.geodetic[3 * slot_index] = g.lat_deg;
    out_.geodetic[3 * slot_index + 1] = g.lon_deg;
    out_.geodetic[3 * slot_index + 2] = g.height_m;
  }
  if (!out_.normal.empty())
    for (int k = 0; k < 3; ++k)
      out_.normal[3 * slot_index + static_cast<std::size_t>(k)] = static_cast<float>(normal[k]);
  if (!out_.angles.empty()) {
    const Vec3 to_camera = -direction / length;
    out_.angles[3 * slot_index] = static_cast<float>(angle_deg(shading.mu0[i]));
    out_.angles[3 * slot_index + 1] = static_cast<float>(angle_deg(shading.mu[i]));
    out_.angles[3 * slot_index + 2] = static_cast<float>(angle_deg(to_camera.dot(request_.sun.direction)));
  }
  if (!out_.lit.empty()) out_.lit[slot_index] = lit;
  if (!out_.gsd.empty()) out_.gsd[slot_index] = spacing_m;
}

void FrameWriter::store_albedo(double albedo, std::size_t pixel) const {
  if (const auto slot_index = slot(pixel)) out_.albedo[*slot_index] = static_cast<float>(albedo);
}

void FrameWriter::store_flow(double right_px, double down_px, std::size_t pixel) const {
  if (const auto slot_index = slot(pixel)) {
    out_.flow[2 * *slot_index] = right_px;
    out_.flow[2 * *slot_index + 1] = down_px;
  }
}

void FrameWriter::store_irradiance(const Irradiance& indirect, double incident, float lit,
                                   std::size_t slot_index) const {
  float* irradiance = &out_.irradiance[3 * slot_index];
  irradiance[0] = static_cast<float>(light_.direct_w_m2 * std::max(incident, 0.0)) * lit;
  irradiance[1] = static_cast<float>(indirect.terrain_w_m2);
  irradiance[2] = static_cast<float>(indirect.earth_w_m2);
}

void FrameWriter::mark(int x, int y, const SurfacePoints& points, int lane) {
  marks_.record(x, y, points, lane, source_at(mesh_, points, lane).index);
}

void FrameWriter::merge(const PixelCounts& counts) {
  const std::lock_guard lock(mutex_);
  total_.hit += counts.hit;
  total_.missing += counts.missing;
  total_.filled += counts.filled;
  total_.blended += counts.blended;
  total_.on_object += counts.on_object;
  total_.on_rock += counts.on_rock;
}

}  // namespace selenograph::engine
