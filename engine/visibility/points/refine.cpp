#include "engine/visibility/points/refine.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "dem/support/vector_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "engine/visibility/points/refine.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SELENOGRAPH_ENGINE_REFINE_SHARED
#define SELENOGRAPH_ENGINE_REFINE_SHARED
namespace selenograph::engine {

// Fraction of a triangle by which a point may lie outside of it and still be taken as on it: micrometres.
constexpr double kOnEdge = 1e-9;

}  // namespace selenograph::engine
#endif

HWY_BEFORE_NAMESPACE();
namespace selenograph::engine::HWY_NAMESPACE {

// Plane and ray, per lane: P = o + t d, weights v and w of b and c. A ray from below gets a distance of -1. off: 1
// where that isn't on the triangle though the lane has one, else 0. Returns whether any is.
bool MeetPlanes(const Facets& t, const Rays& rays, SurfacePoints& p, std::int64_t* off) {
  SELENOGRAPH_INDEPENDENT_LANES
  for (int i = 0; i < kPacket; ++i) {
    const double bx = t.b[0][i] - t.a[0][i], by = t.b[1][i] - t.a[1][i], bz = t.b[2][i] - t.a[2][i];
    const double cx = t.c[0][i] - t.a[0][i], cy = t.c[1][i] - t.a[1][i], cz = t.c[2][i] - t.a[2][i];
    const double nx = by * cz - bz * cy, ny = bz * cx - bx * cz, nz = bx * cy - by * cx;
    const double dx = rays.dx[i], dy = rays.dy[i], dz = rays.dz[i];
    const double toward = nx * dx + ny * dy + nz * dz;
    const double gap = nx * (t.a[0][i] - rays.ox[i]) + ny * (t.a[1][i] - rays.oy[i]) + nz * (t.a[2][i] - rays.oz[i]);
    const double distance = gap / toward;
    const double px = rays.ox[i] + distance * dx, py = rays.oy[i] + distance * dy, pz = rays.oz[i] + distance * dz;
    const double ax = px - t.a[0][i], ay = py - t.a[1][i], az = pz - t.a[2][i];
    const double scale = 1 / (nx * nx + ny * ny + nz * nz);
    const double v = (nx * (ay * cz - az * cy) + ny * (az * cx - ax * cz) + nz * (ax * cy - ay * cx)) * scale;
    const double w = (nx * (by * az - bz * ay) + ny * (bz * ax - bx * az) + nz * (bx * ay - by * ax)) * scale;
    p.x[i] = px, p.y[i] = py, p.z[i] = pz;
    p.nx[i] = nx, p.ny[i] = ny, p.nz[i] = nz;
    p.v[i] = v, p.w[i] = w;
    const double seen = toward < 0 ? distance : -1;
    p.distance[i] = seen;
    const bool on = seen > 0 && v >= -kOnEdge && w >= -kOnEdge && v + w <= 1 + kOnEdge;
    off[i] = on ? 0 : 1;
  }
  std::int64_t any = 0;
  for (int i = 0; i < kPacket; ++i) any |= off[i] &= static_cast<std::int64_t>(p.hit[i]);
  return any != 0;
}

}  // namespace selenograph::engine::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace selenograph::engine {

HWY_EXPORT(MeetPlanes);

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
    const auto lat = static_cast<std::int64_t>((g.lat_deg + 90) * dem::kTicksPerDegree),
               lon = static_cast<std::int64_t>((g.lon_deg + 180) * dem::kTicksPerDegree);
    for (const int dy : {-1, 0, 1})
      for (const int dx : {-1, 0, 1}) {
        // A quarter of a quad: into the first quad of a neighbour, be it finer.
        const std::int64_t y = lat + dy * (e.lat_step / 4), x = lon + dx * std::int64_t{e.lon_step / 4};
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
  p.x[i] = c.position.x(), p.y[i] = c.position.y(), p.z[i] = c.position.z();
  p.nx[i] = c.facing.x(), p.ny[i] = c.facing.y(), p.nz[i] = c.facing.z();
  p.distance[i] = c.distance, p.v[i] = c.v, p.w[i] = c.w;
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

}  // namespace

void refine(const Mesh& mesh, const Rays& rays, SurfacePoints& points, Facets& facets) {
  // An empty mesh has not even a triangle for the lanes without a hit.
  if (hit_bits(points) == 0) return;
  gather(mesh, points.triangle, facets);
  alignas(64) std::int64_t off[kPacket];
  if (!HWY_DYNAMIC_DISPATCH(MeetPlanes)(facets, rays, points, off)) return;
  for (int i = 0; i < kPacket; ++i)
    if (off[i]) correct(mesh, rays, i, points);
  gather(mesh, points.triangle, facets);
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
