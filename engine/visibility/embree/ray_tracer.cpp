#include "engine/visibility/embree/ray_tracer.h"

#include <algorithm>
#include <cmath>

#include "dem/base/parallel.h"
#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/embree/ray_tracer.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_RAY_TRACER_SHARED
#define SELENOGRAPH_ENGINE_RAY_TRACER_SHARED
namespace selenograph::engine {

// Arguments of RayTracer::occluded() for the filter.
struct SunContext {
  float sun[3];           // unit vector toward the Sun
  float rounding_m;       // of a start and its triangle
  const float* burial_m;  // per ray; see StartShadowRays
};

// Returns whether a candidate is the surface that the ray leaves: it faces the Sun, and its plane or its distance is
// within the rounding error.
inline bool is_own_surface(float nx, float ny, float nz, float sx, float sy, float sz, float distance, float rounding2,
                           float burial) {
  const float facing = nx * sx + ny * sy + nz * sz, beneath = distance * facing;
  return (facing >= 0) & ((beneath * beneath <= rounding2 * (nx * nx + ny * ny + nz * nz)) | (distance <= burial));
}

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Clears `valid` of sixteen candidates, lane by lane, where they are the surface that the ray leaves.
void IgnoreOwnSurface16(const Occluders& o, const SunContext& context) {
  const float *nx = o.nx, *ny = o.ny, *nz = o.nz, *distance = o.distance;
  int* valid = o.valid;
  const float sx = context.sun[0], sy = context.sun[1], sz = context.sun[2];
  const float rounding2 = context.rounding_m * context.rounding_m;
  const float* burial = context.burial_m;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i)
    valid[i] = is_own_surface(nx[i], ny[i], nz[i], sx, sy, sz, distance[i], rounding2, burial[i]) ? 0 : valid[i];
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(IgnoreOwnSurface16);

namespace {

// Does the same for any number of candidates: Embree calls the filter with all lanes or with a few.
void ignore_own_surface(const Occluders& o, const SunContext& context) {
  if (o.count == kPacket) return HWY_DYNAMIC_DISPATCH(IgnoreOwnSurface16)(o, context);
  for (std::size_t i = 0; i < o.count; ++i)
    if (o.valid[i] == -1 &&
        is_own_surface(o.nx[i], o.ny[i], o.nz[i], context.sun[0], context.sun[1], context.sun[2], o.distance[i],
                       context.rounding_m * context.rounding_m, context.burial_m[o.ray[i]]))
      o.valid[i] = 0;
}

// Writes the vertices of a block relative to the anchor: x, y, z each, row by row.
void fill_vertices(const MeshBlock& block, const Vec3& anchor, std::span<float> vertices) {
  float* out = vertices.data();
  for (int r = 0; r < block.posts->side(); ++r)
    for (int c = 0; c < block.posts->side(); ++c) {
      const Vec3 vertex = block.vertex(r, c) - anchor;
      for (int k = 0; k < 3; ++k) *out++ = static_cast<float>(vertex[k]);
    }
}

// Returns whether a block has no voids.
bool is_complete(const MeshBlock& block) {
  return std::none_of(block.vertices.begin(), block.vertices.end(),
                      [](const dem::Vertex& v) { return std::isnan(v.height_m); });
}

// Returns the triangles of a block whose three vertices have data.
std::vector<TriangleId> valid_triangles(const MeshBlock& block, std::uint32_t index) {
  std::vector<TriangleId> valid;
  const int quads = block.posts->extent.quads;
  for (int r = 0; r < quads; ++r)
    for (int c = 0; c < quads; ++c)
      for (const bool upper : {false, true}) {
        const dem::QuadVertices q = dem::vertices_of(r, c, upper);
        bool present = true;
        for (int i = 0; i < 3; ++i) present &= block.present(q.r[i], q.c[i]);
        if (present) valid.emplace_back(index, r, c, upper);
      }
  return valid;
}

}  // namespace

struct RayTracer::Impl {
  // Maps a hit on a geometry to a triangle of the mesh.
  struct Numbering {
    int quads = 0;                      // grid without voids: the quad follows from u, v
    std::vector<TriangleId> triangles;  // block with voids: triangle of each primitive
  };

  Impl(const Mesh& mesh, int threads)
      : scene(mesh.blocks().size(), threads, EmbreeScene::Filters::on_occlusion), numbering(mesh.blocks().size()) {}

  // Makes the geometry of a block: a grid, or single triangles if it has voids; none if it has no triangle.
  void set_block(const MeshBlock& block, std::size_t index, const Vec3& anchor) {
    const auto vertices = [&](std::span<float> out) { fill_vertices(block, anchor, out); };
    Numbering& block_numbering = numbering[index];
    if (is_complete(block)) {
      block_numbering.quads = block.posts->extent.quads;
      return scene.set_grid(index, block.posts->side(), vertices);
    }
    // Set the valid triangles one by one: Embree drops a whole grid for one vertex that is not finite.
    block_numbering.triangles = valid_triangles(block, static_cast<std::uint32_t>(index));
    if (block_numbering.triangles.empty()) return;
    scene.set_triangles(index, block.vertices.size(), block_numbering.triangles.size(), vertices,
                        [&](std::span<std::uint32_t> out) {
                          std::uint32_t* corners = out.data();
                          for (const TriangleId& t : block_numbering.triangles) {
                            const dem::QuadVertices q = t.vertices();
                            for (int i = 0; i < 3; ++i)
                              *corners++ = static_cast<std::uint32_t>(block.posts->index(q.r[i], q.c[i]));
                          }
                        });
  }

  // Returns the triangle that lane i hits.
  TriangleId triangle_of(const RayHits& hits, int i) const {
    const Numbering& block_numbering = numbering[hits.geometry[i]];
    if (block_numbering.quads == 0) return block_numbering.triangles[hits.primitive[i]];
    // u and v run over the whole grid. Rounding at the border of a quad is corrected in refine.cpp.
    const float u = hits.u[i] * static_cast<float>(block_numbering.quads);
    const float v = hits.v[i] * static_cast<float>(block_numbering.quads);
    const int c = std::clamp(static_cast<int>(u), 0, block_numbering.quads - 1);
    const int r = std::clamp(static_cast<int>(v), 0, block_numbering.quads - 1);
    return {hits.geometry[i], r, c, (u - static_cast<float>(c)) + (v - static_cast<float>(r)) > 1.F};
  }

  EmbreeScene scene;
  std::vector<Numbering> numbering;  // per geometry, that is, per block
};

RayTracer::RayTracer(const Mesh& mesh, const Vec3& anchor_m, int threads, const StopToken& stop)
    : impl_(std::make_unique<Impl>(mesh, threads)), anchor_(anchor_m) {
  const std::size_t blocks = mesh.blocks().size();
  in_parallel(blocks, [&](std::size_t i) {
    stop.check();
    impl_->set_block(mesh.blocks()[i], i, anchor_);
  });
  for (std::size_t i = 0; i < blocks; ++i) {
    // Measured (Embree 3.13): 15 bytes per triangle in a grid, 83 per single triangle.
    const std::size_t single_triangles = impl_->numbering[i].triangles.size();
    const std::size_t quads = static_cast<std::size_t>(impl_->numbering[i].quads);
    if (single_triangles + quads == 0) continue;
    bytes_ +=
        mesh.blocks()[i].vertices.size() * 12 + 2 * quads * quads * 15 + single_triangles * (83 + sizeof(TriangleId));
  }
  where_loops_run([&] { impl_->scene.build(stop); });
}

RayTracer::~RayTracer() = default;

void RayTracer::intersect(const RayPacket& rays, SurfacePoints& points) const {
  RayHits hits;
  impl_->scene.intersect(rays, hits);
  for (int i = 0; i < kPacket; ++i) {
    points.hit[i] = rays.active[i] && hits.geometry[i] != RayHits::kNone;
    if (points.hit[i]) points.triangle[i] = impl_->triangle_of(hits, i);
  }
}

void RayTracer::occluded(const RayPacket& rays, const Vec3& sun_direction, float rounding_m, const float* burial_m,
                         bool blocked[kPacket]) const {
  SunContext context;
  for (int k = 0; k < 3; ++k) context.sun[k] = static_cast<float>(sun_direction[k]);
  context.rounding_m = rounding_m;
  context.burial_m = burial_m;
  impl_->scene.occluded(rays, blocked, [&](const Occluders& occluders) { ignore_own_surface(occluders, context); });
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
