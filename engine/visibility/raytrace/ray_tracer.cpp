#include "engine/visibility/raytrace/ray_tracer.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <cmath>

#include "dem/parallel.h"
#include "engine/support/vectorise.h"
#include "engine/visibility/raytrace/embree_packets.h"

namespace selenograph::engine {
namespace {

struct SunContext {
  RTCIntersectContext embree;  // first member: Embree hands its address to the filter
  float sun[3];
  float rounding_m;
};

// Whether a candidate is the surface that the ray leaves: it faces the Sun, and its plane is within the rounding.
inline bool is_left(float nx, float ny, float nz, float sx, float sy, float sz, float distance, float rounding2) {
  const float facing = nx * sx + ny * sy + nz * sz, beneath = distance * facing;
  return (facing >= 0) & (beneath * beneath <= rounding2 * (nx * nx + ny * ny + nz * nz));
}

SELENOGRAPH_VECTORISED
void ignore_left_side16(const float* nx, const float* ny, const float* nz, const float* distance,
                        const SunContext& context, int* valid) {
  const float sx = context.sun[0], sy = context.sun[1], sz = context.sun[2],
              rounding2 = context.rounding_m * context.rounding_m;
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i)
    valid[i] = is_left(nx[i], ny[i], nz[i], sx, sy, sz, distance[i], rounding2) ? 0 : valid[i];
}

void ignore_left_side(const RTCFilterFunctionNArguments* args) {
  const auto& context = *reinterpret_cast<const SunContext*>(args->context);
  if (args->N == kPacket) {
    const float* n = &RTCHitN_Ng_x(args->hit, kPacket, 0);
    ignore_left_side16(n, n + kPacket, n + 2 * kPacket, &RTCRayN_tfar(args->ray, kPacket, 0), context, args->valid);
    return;
  }
  for (unsigned i = 0; i < args->N; ++i) {
    if (args->valid[i] != -1) continue;
    if (is_left(RTCHitN_Ng_x(args->hit, args->N, i), RTCHitN_Ng_y(args->hit, args->N, i),
                RTCHitN_Ng_z(args->hit, args->N, i), context.sun[0], context.sun[1], context.sun[2],
                RTCRayN_tfar(args->ray, args->N, i), context.rounding_m * context.rounding_m))
      args->valid[i] = 0;
  }
}

void fill_vertices(const MeshBlock& block, const Vec3& anchor, float* out) {
  for (int r = 0; r < block.posts->side(); ++r)
    for (int c = 0; c < block.posts->side(); ++c) {
      const Vec3 vertex = block.vertex(r, c) - anchor;
      for (int k = 0; k < 3; ++k) *out++ = static_cast<float>(vertex[k]);
    }
}

bool complete(const MeshBlock& block) {
  return std::none_of(block.vertices.begin(), block.vertices.end(),
                      [](const MeshVertex& v) { return std::isnan(v.height_m); });
}

}  // namespace

struct RayTracer::Impl {
  // How a hit on a geometry becomes a triangle of the mesh.
  struct Numbering {
    int quads = 0;                      // a whole grid: the quad follows from u, v
    std::vector<TriangleId> triangles;  // a block with voids: by primitive
  };

  ~Impl() {
    if (scene) rtcReleaseScene(scene);
  }

  static RTCGeometry grid(RTCDevice dev, const MeshBlock& block, const Vec3& anchor) {
    const auto side = static_cast<std::size_t>(block.posts->side());
    RTCGeometry geometry = rtcNewGeometry(dev, RTC_GEOMETRY_TYPE_GRID);
    auto* v = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                          3 * sizeof(float), side * side));
    fill_vertices(block, anchor, v);
    auto* one = static_cast<RTCGrid*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_GRID, 0, RTC_FORMAT_GRID, sizeof(RTCGrid), 1));
    *one = {0, static_cast<unsigned>(side), static_cast<std::uint16_t>(side), static_cast<std::uint16_t>(side)};
    return geometry;
  }

  // Embree drops a whole grid for one vertex that isn't finite: the valid triangles one by one, then. Null when there
  // are none.
  static RTCGeometry triangles(RTCDevice dev, const MeshBlock& block, std::uint32_t index, const Vec3& anchor,
                               Numbering& out) {
    const int quads = block.posts->extent.quads;
    for (int r = 0; r < quads; ++r)
      for (int c = 0; c < quads; ++c)
        for (const bool upper : {false, true}) {
          const dem::QuadVertices q = dem::vertices_of(r, c, upper);
          bool valid = true;
          for (int i = 0; i < 3; ++i) valid &= block.present(q.r[i], q.c[i]);
          if (valid) out.triangles.emplace_back(index, r, c, upper);
        }
    const std::size_t count = out.triangles.size();
    if (count == 0) return nullptr;
    RTCGeometry geometry = rtcNewGeometry(dev, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* v = static_cast<float*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                                          3 * sizeof(float), block.vertices.size()));
    fill_vertices(block, anchor, v);
    auto* corners = static_cast<unsigned*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 3 * sizeof(unsigned), count));
    for (const TriangleId& t : out.triangles) {
      const dem::QuadVertices q = t.vertices();
      for (int i = 0; i < 3; ++i) *corners++ = static_cast<unsigned>(block.posts->index(q.r[i], q.c[i]));
    }
    return geometry;
  }

  TriangleId triangle_of(const RTCHit16& hit, int i) const {
    const Numbering& n = numbering[hit.geomID[i]];
    if (n.quads == 0) return n.triangles[hit.primID[i]];
    // A grid's u and v run over the whole grid. Rounding at a quad's border is for refine.h.
    const float u = hit.u[i] * static_cast<float>(n.quads), v = hit.v[i] * static_cast<float>(n.quads);
    const int c = std::clamp(static_cast<int>(u), 0, n.quads - 1), r = std::clamp(static_cast<int>(v), 0, n.quads - 1);
    return {hit.geomID[i], r, c, (u - static_cast<float>(c)) + (v - static_cast<float>(r)) > 1.F};
  }

  RTCScene scene = nullptr;
  std::vector<Numbering> numbering;  // per geometry, which is per block
};

RayTracer::RayTracer(const Mesh& mesh, const Vec3& anchor_m, int threads)
    : impl_(std::make_unique<Impl>()), anchor_(anchor_m) {
  const RTCDevice dev = embree_device(threads);
  impl_->scene = rtcNewScene(dev);
  rtcSetSceneFlags(impl_->scene, RTC_SCENE_FLAG_ROBUST);
  const std::size_t blocks = mesh.blocks().size();
  std::vector<RTCGeometry> geometries(blocks);
  impl_->numbering.resize(blocks);
  in_parallel(blocks, [&](std::size_t i) {
    const MeshBlock& block = mesh.blocks()[i];
    const bool whole = complete(block);
    if (whole) impl_->numbering[i].quads = block.posts->extent.quads;
    geometries[i] = whole ? impl_->grid(dev, block, anchor_)
                          : impl_->triangles(dev, block, static_cast<std::uint32_t>(i), anchor_, impl_->numbering[i]);
    if (!geometries[i]) return;
    rtcSetGeometryOccludedFilterFunction(geometries[i], ignore_left_side);
    rtcCommitGeometry(geometries[i]);
  });
  for (std::size_t i = 0; i < blocks; ++i) {
    if (!geometries[i]) continue;
    rtcAttachGeometryByID(impl_->scene, geometries[i], static_cast<unsigned>(i));
    rtcReleaseGeometry(geometries[i]);
    // Measured (Embree 3.13): 15 bytes a triangle in a grid, 83 by itself.
    const std::size_t by_itself = impl_->numbering[i].triangles.size(),
                      quads = static_cast<std::size_t>(impl_->numbering[i].quads);
    bytes_ += mesh.blocks()[i].vertices.size() * 12 + 2 * quads * quads * 15 + by_itself * (83 + sizeof(TriangleId));
  }
  tbb::this_task_arena::isolate([&] { rtcCommitScene(impl_->scene); });
  check_embree(dev);
}

RayTracer::~RayTracer() = default;

void RayTracer::intersect(const RayPacket& rays, SurfacePoints& points) const {
  RTCRayHit16 rh;
  engine::intersect(impl_->scene, rays, rh);
  for (int i = 0; i < kPacket; ++i) {
    points.hit[i] = rays.active[i] && rh.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
    if (!points.hit[i]) continue;
    points.triangle[i] = impl_->triangle_of(rh.hit, i);
  }
}

void RayTracer::occluded(const RayPacket& rays, const Vec3& sun_direction, float rounding_m,
                         bool blocked[kPacket]) const {
  SunContext context;
  rtcInitIntersectContext(&context.embree);
  for (int k = 0; k < 3; ++k) context.sun[k] = static_cast<float>(sun_direction[k]);
  context.rounding_m = rounding_m;
  engine::occluded(impl_->scene, rays, context.embree, blocked);
}

}  // namespace selenograph::engine
