#include "engine/visibility/points/refine.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "dem/base/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/points/refine.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_REFINE_SHARED
#define SELENOGRAPH_ENGINE_REFINE_SHARED
namespace selenograph::engine {

// Barycentric distance up to which a point outside a triangle counts as on it: micrometres.
constexpr double kOnEdge = 1e-9;

// State of a lane: the point is on its triangle, is not, or its weights must be recomputed because the triangle is too
// steep to the axis.
enum LaneState : std::int64_t { kOnTriangle = 0, kOffTriangle = 1, kUnknownWeights = 2 };

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Intersects the plane of each triangle with its ray: P = o + t d, with the weights v and w of the vertices b and c.
// Weights are those of the triangle projected along an axis: half the arithmetic of weights in the plane itself, and as
// accurate to 1e-14 unless the axis is within a degree of the plane. A ray from below gets the distance -1. `states`:
// the LaneState of each hit lane, kOnTriangle for all others. Returns the bitwise or of all states.
template <int axis>
std::int64_t IntersectPlanes(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* states) {
  constexpr int i0 = (axis + 1) % 3;
  constexpr int i1 = (axis + 2) % 3;
  constexpr double kSteepest = 2500;  // square of the tangent of the angle between normal and axis
  const double* origin[3] = {rays.ox, rays.oy, rays.oz};
  const double* direction[3] = {rays.dx, rays.dy, rays.dz};
  double* position[3] = {p.x, p.y, p.z};
  double* normal[3] = {p.nx, p.ny, p.nz};
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double bx = t.b[0][i] - t.a[0][i], by = t.b[1][i] - t.a[1][i], bz = t.b[2][i] - t.a[2][i];
    const double cx = t.c[0][i] - t.a[0][i], cy = t.c[1][i] - t.a[1][i], cz = t.c[2][i] - t.a[2][i];
    const double b[3] = {bx, by, bz}, c[3] = {cx, cy, cz};
    const double n[3] = {by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx};
    const double d[3] = {direction[0][i], direction[1][i], direction[2][i]};
    const double toward = n[0] * d[0] + n[1] * d[1] + n[2] * d[2];
    const double gap =
        n[0] * (t.a[0][i] - origin[0][i]) + n[1] * (t.a[1][i] - origin[1][i]) + n[2] * (t.a[2][i] - origin[2][i]);
    const double distance = gap / toward;
    const double point[3] = {origin[0][i] + distance * d[0], origin[1][i] + distance * d[1],
                             origin[2][i] + distance * d[2]};
    const double from_a0 = point[i0] - t.a[i0][i], from_a1 = point[i1] - t.a[i1][i], scale = 1 / n[axis];
    const double v = (from_a0 * c[i1] - from_a1 * c[i0]) * scale;
    const double w = (b[i0] * from_a1 - b[i1] * from_a0) * scale;
    for (int k = 0; k < 3; ++k) {
      position[k][i] = point[k];
      normal[k][i] = n[k];
    }
    p.v[i] = v;
    p.w[i] = w;
    const double distance_from_above = toward < 0 ? distance : -1;
    p.distance[i] = distance_from_above;
    const bool on_triangle = distance_from_above > 0 && v >= -kOnEdge && w >= -kOnEdge && v + w <= 1 + kOnEdge;
    const bool steep = !(n[i0] * n[i0] + n[i1] * n[i1] <= kSteepest * (n[axis] * n[axis]));
    states[i] = (on_triangle ? kOnTriangle : kOffTriangle) | (steep ? kUnknownWeights : kOnTriangle);
  }
  std::int64_t all_states = 0;
  // The mask is all ones for a hit, else 0.
  for (int i = 0; i < kPacket; ++i) all_states |= states[i] &= -static_cast<std::int64_t>(p.hit[i]);
  return all_states;
}

std::int64_t IntersectAlongX(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* states) {
  return IntersectPlanes<0>(t, rays, p, states);
}
std::int64_t IntersectAlongY(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* states) {
  return IntersectPlanes<1>(t, rays, p, states);
}
std::int64_t IntersectAlongZ(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* states) {
  return IntersectPlanes<2>(t, rays, p, states);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(IntersectAlongX);
HWY_EXPORT(IntersectAlongY);
HWY_EXPORT(IntersectAlongZ);

namespace {

// Intersection of a ray with the plane of a triangle; members as in SurfacePoints.
struct Candidate {
  TriangleId triangle;
  Vec3 position, facing;
  double distance, v, w;
  // Returns the barycentric distance from the triangle; negative inside.
  double outside() const { return std::max({-v, -w, v + w - 1}); }
};

// Intersects the ray with the plane of a triangle that it reaches from above (against its outward normal) or from
// below; empty if it reaches it from the other side, is parallel to it, or the triangle is degenerate or without data.
std::optional<Candidate> intersect_plane(const Mesh& mesh, const TriangleId& id, const Vec3& origin,
                                         const Vec3& direction, bool from_below) {
  const dem::Triangle t = mesh.triangle(id);
  const Vec3 ab = t.b - t.a, ac = t.c - t.a, normal = ab.cross(ac);
  const double toward = normal.dot(direction);
  if (!(from_below ? toward > 0 : toward < 0)) return std::nullopt;
  const double distance = normal.dot(t.a - origin) / toward;
  const Vec3 position = origin + distance * direction, from_a = position - t.a;
  const double area2 = normal.squared_norm();
  return Candidate{
      id, position, normal, distance, normal.dot(from_a.cross(ac)) / area2, normal.dot(ab.cross(from_a)) / area2};
}

std::optional<Candidate> intersect_from_above(const Mesh& mesh, const TriangleId& id, const Vec3& origin,
                                              const Vec3& direction) {
  return intersect_plane(mesh, id, origin, direction, false);
}

// Returns the largest distance at which the ray can see: where it reaches, from below, the triangle that float found.
// At an outline the ray has hit the other side of the surface just before; otherwise it came through a hole in the
// data, and nothing behind may be visible.
double visible_distance(const Mesh& mesh, const TriangleId& id, const Vec3& origin, const Vec3& direction) {
  const auto below = intersect_plane(mesh, id, origin, direction, true);
  if (!below || !(below->outside() <= 0)) return std::numeric_limits<double>::infinity();
  return below->distance + 1e-6 + 1e-14 * below->distance;  // more than the rounding error of double
}

// Searches the triangles around a guess that is off its triangle. Of the intersections up to `farthest`, the one
// nearest to `near` along the ray wins.
class Search {
 public:
  Search(const Mesh& mesh, const Vec3& origin, const Vec3& direction, double near, double farthest,
         double max_miss = kMaxMiss)
      : mesh_(mesh), origin_(origin), direction_(direction), near_(near), farthest_(farthest), max_miss_(max_miss) {}

  const std::optional<Candidate>& best() const { return best_; }
  // Returns the triangle that the ray misses by the least, within max_miss; for rays without a best one.
  const std::optional<Candidate>& near_miss() const { return near_miss_; }

  // Searches a quad of a block and its up to eight neighbours in the block.
  void quads_around(std::uint32_t block, int row, int col) {
    const int quads = mesh_.blocks()[block].posts->extent.quads;
    for (int r = std::max(0, row - 1); r <= std::min(quads - 1, row + 1); ++r)
      for (int c = std::max(0, col - 1); c <= std::min(quads - 1, col + 1); ++c)
        for (const bool upper : {false, true}) consider({block, r, c, upper});
  }

  // Searches the blocks next to the point, in their nearest quads, but not the block `except`.
  void blocks_around(const Vec3& point, std::uint32_t except) {
    const dem::BlockExtent& e = mesh_.blocks()[except].posts->extent;
    const Geographic g = to_geographic(point);
    const auto lat = static_cast<dem::Tick>((g.lat_deg + 90) * dem::kTicksPerDegree);
    const auto lon = static_cast<dem::Tick>((g.lon_deg + 180) * dem::kTicksPerDegree);
    for (const int dy : {-1, 0, 1})
      for (const int dx : {-1, 0, 1}) {
        // Step a quarter of a quad: into the first quad of a neighbour, even of a finer one.
        const dem::Tick y = lat + dy * (e.lat_step / 4);
        const dem::Tick x = lon + dx * (e.lon_step / 4);
        const auto found = mesh_.block_at(y, x);
        if (!found || *found == except) continue;
        const dem::BlockExtent& n = mesh_.blocks()[*found].posts->extent;
        quads_around(*found, dem::steps_in(y - n.lat0, n.lat_step),
                     dem::steps_in(dem::wrap_lon(x) - n.lon0, n.lon_step));
      }
    if (lat < e.lat_step || lat > dem::kLatTicks - e.lat_step) quads_at_pole(lat > e.lat_step);
  }

 private:
  // Searches the rows at a pole, where the last row of every block collapses to one vertex.
  void quads_at_pole(bool north) {
    for (std::uint32_t b = 0; b < mesh_.blocks().size(); ++b) {
      const dem::BlockExtent& e = mesh_.blocks()[b].posts->extent;
      if (north ? e.lat1() != dem::kLatTicks : e.lat0 != 0) continue;
      const int r = north ? e.quads - 1 : 0;
      for (int c = 0; c < e.quads; ++c)
        for (const bool upper : {false, true}) {
          consider({b, r, c, upper});
          if (best_) return;
        }
    }
  }

  void consider(const TriangleId& id) {
    const auto p = intersect_from_above(mesh_, id, origin_, direction_);
    if (!p || p->distance > farthest_) return;
    const double outside = p->outside();
    if (outside <= max_miss_ && (!near_miss_ || outside < near_miss_->outside())) near_miss_ = p;
    if (!(outside <= kOnEdge)) return;
    if (!best_ || std::abs(p->distance - near_) < std::abs(best_->distance - near_)) best_ = p;
  }

  const Mesh& mesh_;
  Vec3 origin_, direction_;
  double near_, farthest_, max_miss_;
  std::optional<Candidate> best_, near_miss_;
};

void store(const Candidate& found, int i, SurfacePoints& points) {
  points.triangle[i] = found.triangle;
  points.x[i] = found.position.x();
  points.y[i] = found.position.y();
  points.z[i] = found.position.z();
  points.nx[i] = found.facing.x();
  points.ny[i] = found.facing.y();
  points.nz[i] = found.facing.z();
  points.distance[i] = found.distance;
  points.v[i] = found.v;
  points.w[i] = found.w;
}

// Finds the triangle of a lane whose point is off its triangle: the other half of the quad, or a neighbour.
void search_triangle(const Mesh& mesh, const Rays& rays, int i, double max_miss, SurfacePoints& points) {
  const Vec3 origin = rays.origin(i), direction = rays.direction(i);
  TriangleId id = points.triangle[i];
  auto guess = intersect_from_above(mesh, id, origin, direction);
  if (!guess) {
    id = id.other_half();
    guess = intersect_from_above(mesh, id, origin, direction);
  }
  // Without a guess the ray meets neither half from above: an outline seen edge-on, or a collapsed quad. The triangle
  // that the ray hits is next to it, so search around a vertex.
  const Vec3 point = guess ? guess->position : mesh.triangle(id).a;
  const double distance = guess ? guess->distance : (point - origin).dot(direction) / direction.squared_norm();
  Search search(mesh, origin, direction, distance, visible_distance(mesh, points.triangle[i], origin, direction),
                max_miss);
  search.quads_around(id.block(), id.r(), id.c());
  if (!search.best()) search.blocks_around(point, id.block());
  const std::optional<Candidate>& found = search.best() ? search.best() : search.near_miss();
  points.hit[i] = found && found->distance > 0;
  if (found) store(*found, i, points);
}

// Calls IntersectPlanes for an axis of MOON_ME.
std::int64_t intersect_along(int axis, const Facets& facets, const Rays& rays, SurfacePoints& points,
                             std::int64_t* states) {
  if (axis == 0) return HWY_DYNAMIC_DISPATCH(IntersectAlongX)(facets, rays, points, states);
  if (axis == 1) return HWY_DYNAMIC_DISPATCH(IntersectAlongY)(facets, rays, points, states);
  return HWY_DYNAMIC_DISPATCH(IntersectAlongZ)(facets, rays, points, states);
}

// Intersects each lane along the axis of its block, so that the weights of a point never depend on the other lanes of
// the packet.
std::int64_t intersect_along_block_axes(const Mesh& mesh, const Facets& facets, const Rays& rays, SurfacePoints& points,
                                        std::int64_t* states) {
  std::uint32_t lanes[3] = {};  // lanes of each axis, one bit each
  for (std::uint32_t i = 0; i < kPacket; ++i) lanes[mesh.blocks()[points.triangle[i].block()].axis] |= 1U << i;
  std::int64_t all_states = kOnTriangle;
  double v[kPacket], w[kPacket];  // only the weights depend on the axis
  for (int axis = 0; axis < 3; ++axis) {
    if (lanes[axis] == 0) continue;
    alignas(64) std::int64_t states_along[kPacket];
    intersect_along(axis, facets, rays, points, states_along);
    for (int i = 0; i < kPacket; ++i)
      if (lanes[axis] >> i & 1) {
        v[i] = points.v[i];
        w[i] = points.w[i];
        all_states |= states[i] = states_along[i];
      }
  }
  std::copy_n(v, kPacket, points.v);
  std::copy_n(w, kPacket, points.w);
  return all_states;
}

// Recomputes the weights of lane i in the plane of the triangle itself, and then its state.
void recompute_weights(const Facets& facets, SurfacePoints& points, int i, std::int64_t& state) {
  const Vec3 a(facets.a[0][i], facets.a[1][i], facets.a[2][i]), b(facets.b[0][i], facets.b[1][i], facets.b[2][i]),
      c(facets.c[0][i], facets.c[1][i], facets.c[2][i]);
  const Vec3 n = points.facet_normal(i), from_a = points.position(i) - a;
  points.v[i] = n.dot(from_a.cross(c - a)) / n.squared_norm();
  points.w[i] = n.dot((b - a).cross(from_a)) / n.squared_norm();
  const bool on_triangle = points.distance[i] > 0 && points.v[i] >= -kOnEdge && points.w[i] >= -kOnEdge &&
                           points.v[i] + points.w[i] <= 1 + kOnEdge;
  state = on_triangle ? kOnTriangle : kOffTriangle;
}

// Intersects each lane with its own triangle. Returns the bitwise or of the states.
std::int64_t intersect_own_triangles(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets,
                                     std::int64_t* states) {
  gather(mesh, points.triangle, facets);
  std::int64_t all_states =
      in_one_block(points.triangle)
          ? intersect_along(mesh.blocks()[points.triangle[0].block()].axis, facets, rays, points, states)
          : intersect_along_block_axes(mesh, facets, rays, points, states);
  if (!(all_states & kUnknownWeights)) return all_states;
  all_states = kOnTriangle;
  for (int i = 0; i < kPacket; ++i) {
    if (states[i] & kUnknownWeights) recompute_weights(facets, points, i, states[i]);
    all_states |= states[i];
  }
  return all_states;
}

}  // namespace

void refine(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets, double max_miss) {
  // Return early: an empty mesh has no triangle to gather for lanes without a hit.
  if (hit_bits(points) == 0) return;
  alignas(64) std::int64_t states[kPacket];
  if (intersect_own_triangles(mesh, rays, points, facets, states) == kOnTriangle) return;
  for (int i = 0; i < kPacket; ++i)
    if (states[i]) search_triangle(mesh, rays, i, max_miss, points);
  // Recompute the points: the search used other sums, and a point must not depend on the triangle that float proposed.
  intersect_own_triangles(mesh, rays, points, facets, states);
}

bool buried(const Mesh& mesh, const TriangleId& nearby, const Vec3& point) {
  // Measure the distance to the surface from a kilometre above the point.
  constexpr double kAbove_m = 1000;
  const Vec3 down = -point.normalized(), origin = point - kAbove_m * down;
  Search search(mesh, origin, down, kAbove_m, std::numeric_limits<double>::infinity());
  search.quads_around(nearby.block(), nearby.r(), nearby.c());
  if (!search.best()) search.blocks_around(point, nearby.block());
  return search.best() && search.best()->distance < kAbove_m - 1e-9;
}

Vec3 shading_normal(const Mesh& mesh, const SurfacePoints& points, int lane, const Vec3& direction) {
  const TriangleId& t = points.triangle[lane];
  const MeshBlock& block = mesh.blocks()[t.block()];
  const dem::QuadVertices q = t.vertices();
  const auto vertex_normal = [&](int i) -> Vec3 { return block.normal(q.r[i], q.c[i]).cast<double>(); };
  const double v = points.v[lane], w = points.w[lane];
  const Vec3 smooth = (1 - v - w) * vertex_normal(0) + v * vertex_normal(1) + w * vertex_normal(2);
  return (smooth.dot(direction) < 0 ? smooth : points.facet_normal(lane)).normalized();
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
