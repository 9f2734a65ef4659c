#include "engine/visibility/points/refine.h"

#include <Eigen/Geometry>
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

// Fraction of a triangle by which a point may lie outside of it and still be taken as on it: micrometres.
constexpr double kOnEdge = 1e-9;

// Of a lane: its point is on its triangle; not; its weights are not known.
enum LaneState : std::int64_t { kOn = 0, kOff = 1, kSteep = 2 };

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Plane and ray, per lane: P = o + t d, weights v and w of b and c. A ray from below gets a distance of -1. off: kOff
// where that isn't on the triangle though the lane has one, kSteep where the weights are not known. Returns the sum of
// what lanes that hit say. Weights are those of the triangle as seen along an axis: half of the arithmetic that they
// take in the plane itself, and as good to 1e-14 unless the axis is within a degree of that plane.
template <int axis>
std::int64_t MeetPlanes(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* off) {
  constexpr int i0 = (axis + 1) % 3;
  constexpr int i1 = (axis + 2) % 3;
  constexpr double kSteepest = 2500;  // squares of tangents
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
    const double at[3] = {origin[0][i] + distance * d[0], origin[1][i] + distance * d[1],
                          origin[2][i] + distance * d[2]};
    const double from_a0 = at[i0] - t.a[i0][i], from_a1 = at[i1] - t.a[i1][i], scale = 1 / n[axis];
    const double v = (from_a0 * c[i1] - from_a1 * c[i0]) * scale;
    const double w = (b[i0] * from_a1 - b[i1] * from_a0) * scale;
    for (int k = 0; k < 3; ++k) {
      position[k][i] = at[k];
      normal[k][i] = n[k];
    }
    p.v[i] = v;
    p.w[i] = w;
    const double seen = toward < 0 ? distance : -1;
    p.distance[i] = seen;
    const bool on = seen > 0 && v >= -kOnEdge && w >= -kOnEdge && v + w <= 1 + kOnEdge;
    const bool steep = !(n[i0] * n[i0] + n[i1] * n[i1] <= kSteepest * (n[axis] * n[axis]));
    off[i] = (on ? kOn : kOff) | (steep ? kSteep : kOn);
  }
  std::int64_t any = 0;
  for (int i = 0; i < kPacket; ++i) any |= off[i] &= -static_cast<std::int64_t>(p.hit[i]);
  return any;
}

std::int64_t MeetAlongX(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* off) {
  return MeetPlanes<0>(t, rays, p, off);
}
std::int64_t MeetAlongY(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* off) {
  return MeetPlanes<1>(t, rays, p, off);
}
std::int64_t MeetAlongZ(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* off) {
  return MeetPlanes<2>(t, rays, p, off);
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(MeetAlongX);
HWY_EXPORT(MeetAlongY);
HWY_EXPORT(MeetAlongZ);

namespace {

// The same for float, which may take a ray to hit a triangle that it passes by millimetres.
constexpr double kBlur = 1e-3;

struct Candidate {
  TriangleId triangle;
  Vec3 position, facing;
  double distance, v, w;
  // How far outside of its triangle, in barycentric terms; negative inside.
  double outside() const { return std::max({-v, -w, v + w - 1}); }
};

// Where the ray meets the triangle's plane, if it comes from above (toward < 0) or if it comes from below.
std::optional<Candidate> cross(const Mesh& mesh, const TriangleId& id, const Vec3& origin, const Vec3& direction,
                               bool from_below) {
  const dem::Triangle t = mesh.triangle(id);
  const Vec3 ab = t.b - t.a, ac = t.c - t.a, normal = ab.cross(ac);
  const double toward = normal.dot(direction);
  if (!(from_below ? toward > 0 : toward < 0)) return std::nullopt;  // or along it, degenerate or without data
  const double distance = normal.dot(t.a - origin) / toward;
  const Vec3 position = origin + distance * direction, from_a = position - t.a;
  const double area2 = normal.squaredNorm();
  return Candidate{
      id, position, normal, distance, normal.dot(from_a.cross(ac)) / area2, normal.dot(ab.cross(from_a)) / area2};
}

std::optional<Candidate> meet(const Mesh& mesh, const TriangleId& id, const Vec3& origin, const Vec3& direction) {
  return cross(mesh, id, origin, direction, false);
}

// How far a ray can see at most: where it crosses the triangle that float found from below, if it does. Over an outline
// it has met the surface's other side just before; else it came through a hole in the data, and whatever lies behind
// isn't to be seen.
double end_of_sight(const Mesh& mesh, const TriangleId& id, const Vec3& origin, const Vec3& direction) {
  const auto below = cross(mesh, id, origin, direction, true);
  if (!below || !(below->outside() <= 0)) return std::numeric_limits<double>::infinity();
  return below->distance + 1e-6 + 1e-14 * below->distance;  // more than double rounds
}

// Searches around a guess that is off its triangle; the answer nearest to `near` along the ray wins. None is farther
// than `farthest`.
class Search {
 public:
  Search(const Mesh& mesh, const Vec3& origin, const Vec3& direction, double near, double farthest)
      : mesh_(mesh), origin_(origin), direction_(direction), near_(near), farthest_(farthest) {}

  const std::optional<Candidate>& best() const { return best_; }
  // Failing that, the triangle that the ray misses by the least, if that is within float's rounding.
  const std::optional<Candidate>& nearly() const { return nearly_; }

  void quads_around(std::uint32_t block, int row, int col) {
    const int quads = mesh_.blocks()[block].posts->extent.quads;
    for (int r = std::max(0, row - 1); r <= std::min(quads - 1, row + 1); ++r)
      for (int c = std::max(0, col - 1); c <= std::min(quads - 1, col + 1); ++c)
        for (const bool upper : {false, true}) consider({block, r, c, upper});
  }

  // Blocks beside the place, and the quads of theirs that are nearest.
  void blocks_around(const Vec3& place, std::uint32_t except) {
    const dem::BlockExtent& e = mesh_.blocks()[except].posts->extent;
    const Geographic g = to_geographic(place);
    const auto lat = static_cast<std::int64_t>((g.lat_deg + 90) * dem::kTicksPerDegree);
    const auto lon = static_cast<std::int64_t>((g.lon_deg + 180) * dem::kTicksPerDegree);
    for (const int dy : {-1, 0, 1})
      for (const int dx : {-1, 0, 1}) {
        // A quarter of a quad: into the first quad of a neighbour, be it finer.
        const std::int64_t y = lat + dy * (e.lat_step / 4);
        const std::int64_t x = lon + dx * std::int64_t{e.lon_step / 4};
        const auto found = mesh_.block_at(y, x);
        if (!found || *found == except) continue;
        const dem::BlockExtent& n = mesh_.blocks()[*found].posts->extent;
        quads_around(*found, static_cast<int>((y - n.lat0) / n.lat_step), (dem::wrap_lon(x) - n.lon0) / n.lon_step);
      }
    if (lat < e.lat_step || lat > dem::kLatTicks - e.lat_step) quads_at_pole(lat > e.lat_step);
  }

 private:
  // Around a pole every block's last row meets in one vertex.
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
    const auto p = meet(mesh_, id, origin_, direction_);
    if (!p || p->distance > farthest_) return;
    const double outside = p->outside();
    if (outside <= kBlur && (!nearly_ || outside < nearly_->outside())) nearly_ = p;
    if (!(outside <= kOnEdge)) return;
    if (!best_ || std::abs(p->distance - near_) < std::abs(best_->distance - near_)) best_ = p;
  }

  const Mesh& mesh_;
  Vec3 origin_, direction_;
  double near_, farthest_;
  std::optional<Candidate> best_, nearly_;
};

void store(const Candidate& c, int i, SurfacePoints& p) {
  p.triangle[i] = c.triangle;
  p.x[i] = c.position.x();
  p.y[i] = c.position.y();
  p.z[i] = c.position.z();
  p.nx[i] = c.facing.x();
  p.ny[i] = c.facing.y();
  p.nz[i] = c.facing.z();
  p.distance[i] = c.distance;
  p.v[i] = c.v;
  p.w[i] = c.w;
}

// Off its triangle, or the quad's other half was meant.
void correct(const Mesh& mesh, const Rays& rays, int i, SurfacePoints& points) {
  const Vec3 origin = rays.origin(i), direction = rays.direction(i);
  TriangleId id = points.triangle[i];
  auto guess = meet(mesh, id, origin, direction);
  if (!guess) {
    id = id.other_half();
    guess = meet(mesh, id, origin, direction);
  }
  // Neither half: an outline seen edge-on or a quad that has collapsed. What the ray meets is beside it.
  const Vec3 place = guess ? guess->position : mesh.triangle(id).a;
  const double distance = guess ? guess->distance : (place - origin).dot(direction) / direction.squaredNorm();
  Search search(mesh, origin, direction, distance, end_of_sight(mesh, points.triangle[i], origin, direction));
  search.quads_around(id.block(), id.r(), id.c());
  if (!search.best()) search.blocks_around(place, id.block());
  const std::optional<Candidate>& found = search.best() ? search.best() : search.nearly();
  points.hit[i] = found && found->distance > 0;
  if (found) store(*found, i, points);
}

std::int64_t meet_along(int axis, const Facets& facets, const Rays& rays, SurfacePoints& points, std::int64_t* off) {
  if (axis == 0) return HWY_DYNAMIC_DISPATCH(MeetAlongX)(facets, rays, points, off);
  if (axis == 1) return HWY_DYNAMIC_DISPATCH(MeetAlongY)(facets, rays, points, off);
  return HWY_DYNAMIC_DISPATCH(MeetAlongZ)(facets, rays, points, off);
}

// Each lane along its block's axis, so that a triangle's weights never depend on the packet.
std::int64_t meet_along_own(const Mesh& mesh, const Facets& facets, const Rays& rays, SurfacePoints& points,
                            std::int64_t* off) {
  std::uint32_t lanes[3] = {};  // by axis, a bit each
  for (std::uint32_t i = 0; i < kPacket; ++i) lanes[mesh.blocks()[points.triangle[i].block()].axis] |= 1U << i;
  std::int64_t any = kOn;
  double v[kPacket], w[kPacket];  // nothing else depends on the axis
  for (int axis = 0; axis < 3; ++axis) {
    if (lanes[axis] == 0) continue;
    alignas(64) std::int64_t off_along[kPacket];
    meet_along(axis, facets, rays, points, off_along);
    for (int i = 0; i < kPacket; ++i)
      if (lanes[axis] >> i & 1) {
        v[i] = points.v[i];
        w[i] = points.w[i];
        any |= off[i] = off_along[i];
      }
  }
  std::copy_n(v, kPacket, points.v);
  std::copy_n(w, kPacket, points.w);
  return any;
}

// Weights in the triangle's own plane.
void weigh(const Facets& t, SurfacePoints& p, int i, std::int64_t& off) {
  const Vec3 a(t.a[0][i], t.a[1][i], t.a[2][i]), b(t.b[0][i], t.b[1][i], t.b[2][i]), c(t.c[0][i], t.c[1][i], t.c[2][i]);
  const Vec3 n = p.facet_normal(i), from_a = p.position(i) - a;
  p.v[i] = n.dot(from_a.cross(c - a)) / n.squaredNorm();
  p.w[i] = n.dot((b - a).cross(from_a)) / n.squaredNorm();
  const bool on = p.distance[i] > 0 && p.v[i] >= -kOnEdge && p.w[i] >= -kOnEdge && p.v[i] + p.w[i] <= 1 + kOnEdge;
  off = on ? kOn : kOff;
}

// Meets the lanes' own triangles. Returns the sum of the lanes' states.
std::int64_t meet_own_triangles(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets,
                                std::int64_t* off) {
  gather(mesh, points.triangle, facets);
  std::int64_t any = in_one_block(points.triangle)
                         ? meet_along(mesh.blocks()[points.triangle[0].block()].axis, facets, rays, points, off)
                         : meet_along_own(mesh, facets, rays, points, off);
  if (!(any & kSteep)) return any;
  any = kOn;
  for (int i = 0; i < kPacket; ++i) {
    if (off[i] & kSteep) weigh(facets, points, i, off[i]);
    any |= off[i];
  }
  return any;
}

}  // namespace

void refine(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets) {
  // An empty mesh has not even a triangle for the lanes without a hit.
  if (hit_bits(points) == 0) return;
  alignas(64) std::int64_t off[kPacket];
  if (meet_own_triangles(mesh, rays, points, facets, off) == kOn) return;
  for (int i = 0; i < kPacket; ++i)
    if (off[i]) correct(mesh, rays, i, points);
  // The search found the triangles by other sums. A point must not depend on the triangle that float proposed.
  meet_own_triangles(mesh, rays, points, facets, off);
}

bool buried(const Mesh& mesh, const TriangleId& beside, const Vec3& place) {
  // Looking down from a kilometre above: how far is it to the surface?
  constexpr double kAbove_m = 1000;
  const Vec3 down = -place.normalized(), origin = place - kAbove_m * down;
  Search search(mesh, origin, down, kAbove_m, std::numeric_limits<double>::infinity());
  search.quads_around(beside.block(), beside.r(), beside.c());
  if (!search.best()) search.blocks_around(place, beside.block());
  return search.best() && search.best()->distance < kAbove_m - 1e-9;
}

Vec3 shading_normal(const Mesh& mesh, const SurfacePoints& points, int lane, const Vec3& direction) {
  const TriangleId& t = points.triangle[lane];
  const MeshBlock& block = mesh.blocks()[t.block()];
  const dem::QuadVertices q = t.vertices();
  const auto at = [&](int i) -> Vec3 { return block.normal(q.r[i], q.c[i]).cast<double>(); };
  const double v = points.v[lane], w = points.w[lane];
  const Vec3 smooth = (1 - v - w) * at(0) + v * at(1) + w * at(2);
  return (smooth.dot(direction) < 0 ? smooth : points.facet_normal(lane)).normalized();
}

}  // namespace selenograph::engine
#endif  // HWY_ONCE
