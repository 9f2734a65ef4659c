#include "engine/limb/limb_in_view.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <queue>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/grid/surface.h"
#include "dem/terrain/finest_surface.h"
#include "dem/terrain/pyramid_terrain.h"
#include "dem/terrain/surface_place.h"
#include "engine/cache/render_context.h"
#include "engine/camera/row_views.h"
#include "engine/rays/ray_queries.h"
#include "engine/scene/bounded_nodes.h"
#include "engine/scene/selection.h"
#include "dem/grid/rotation.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

constexpr double kHighest_m = kMoonRadius_m + double{dem::kHighestRelief_m};

// A viewpoint and the frame of its half planes, one per azimuth. A half plane begins at the line from the viewpoint to
// the Moon's centre. A point in it has the coordinates ahead_m, along that line from the centre, and aside_m, across
// it.
//
//                aside ^      limb point
//                      |    .--*-.           The limb of a half plane is the point with the largest angle at the
//                      |  .'   |  '.         viewpoint. For the terminator the viewpoint is the Sun.
//   viewpoint  --------|-----(centre)----> ahead
//     \__ angle_rad
struct Viewpoint {
  explicit Viewpoint(const View& view)
      : from_m(view.position()), distance_m(from_m.norm()), center(-from_m / distance_m) {
    const auto turn = shortest_turn(view.moon_from_camera().col(2), center);
    right = turn * view.moon_from_camera().col(0);
    down = turn * view.moon_from_camera().col(1);
  }
  // The Sun's viewpoint; azimuths from north to east.
  explicit Viewpoint(const Sun& sun)
      : from_m(sun.distance_au * kAstronomicalUnit_m * sun.direction),
        distance_m(from_m.norm()),
        center(-sun.direction) {
    const EastNorthUp axes = local_axes(sun.direction);
    right = axes.north;
    down = axes.east;
  }

  // Returns the direction across the center line in a half plane.
  Vec3 aside(double azimuth_rad) const { return std::cos(azimuth_rad) * right + std::sin(azimuth_rad) * down; }
  // Returns the angle at the viewpoint between a point and the Moon's centre.
  double angle_rad(double ahead_m, double aside_m) const { return std::atan2(aside_m, distance_m + ahead_m); }
  // Returns that angle for the limb of a sphere; pi from inside it.
  double limb_rad(double radius_m) const {
    return radius_m < distance_m ? std::asin(radius_m / distance_m) : std::numbers::pi;
  }
  // Returns the distance to the limb of the datum.
  double to_limb_m() const { return std::sqrt(std::max(distance_m * distance_m - kMoonRadius_m * kMoonRadius_m, 1e6)); }

  Vec3 from_m;
  double distance_m;
  Vec3 center, right, down;  // unit, perpendicular; center: toward the Moon's centre
};

// Finds the terrain's limb in a half plane: the largest angle from the Moon's centre over all triangles that the plane
// cuts. The plane cuts a segment out of a triangle, and the segment's larger angle is at an end, on an edge of the
// triangle. Best-first search: blocks are visited in falling order of upper bounds on their angles, which follow from
// bounds on their heights, until no bound exceeds the largest angle found.
class LimbSearch {
 public:
  LimbSearch(const Viewpoint& viewpoint, double azimuth_rad, const dem::Terrain& terrain, const StopToken& stop)
      : viewpoint_(viewpoint),
        aside_(viewpoint.aside(azimuth_rad)),
        normal_(viewpoint.center.cross(aside_)),
        terrain_(terrain),
        stop_(stop) {}

  struct Root {
    BlockId id;
    NodeBounds loose;  // for the global range of heights
  };
  // Searches the blocks below these roots.
  void search(const std::vector<Root>& roots) {
    for (const Root& root : roots) add(root.id, upper_rad(root.loose), false);
    while (!candidates_.empty() && candidates_.top().upper_rad > best_rad_) {
      stop_.check();
      const Candidate next = candidates_.top();
      candidates_.pop();
      if (!next.measured) {
        if (const auto bounds = measured(next.id)) add(next.id, std::min(next.upper_rad, upper_rad(*bounds)), true);
      } else if (next.id.level >= terrain_.finest_level(next.id)) {
        cut(next.id);
      } else {
        for (const BlockId& child : dem::children_of(next.id))
          add(child, std::min(next.upper_rad, upper_rad(loose_bounds(child))), false);
      }
    }
  }

  // Returns whether the half plane has a limb, with data all along the line of sight to it.
  bool found() const { return best_rad_ > 0 && has_data_below(); }
  double angle_rad() const { return best_rad_; }
  const Vec3& position_m() const { return position_m_; }

 private:
  struct Candidate {
    double upper_rad;
    BlockId id;
    bool measured;  // the bound follows from the block's own heights, not from the global range of heights
    bool operator<(const Candidate& other) const {
      return std::pair(upper_rad, other.id) < std::pair(other.upper_rad, id);
    }
  };
  // Queues a block unless its bound is below the largest angle found.
  void add(const BlockId& id, double upper_rad, bool measured) {
    if (upper_rad > best_rad_) candidates_.push({upper_rad, id, measured});
  }

  // Returns an upper bound of a block's angles at the viewpoint; 0 if the half plane does not cut the block. Seen from
  // the Moon's centre the block lies between two directions of the plane. The angle at the viewpoint grows with the
  // radius. With the direction it grows up to the limb of the sphere of that radius and falls beyond it.
  double upper_rad(const NodeBounds& b) const {
    if (std::abs(normal_.dot(b.centre)) > b.radius_m || aside_.dot(b.centre) < -b.radius_m) return 0;
    // Offsets of the points from the half plane, and their angles at the Moon's centre from the viewpoint.
    double before_m = std::numeric_limits<double>::infinity(), behind_m = -before_m;
    double first_rad = std::numbers::pi, last_rad = 0;
    bool reaches_half_plane = false;
    for (const Vec3& p : b.points) {
      const double across_m = normal_.dot(p), aside_m = aside_.dot(p);
      before_m = std::min(before_m, across_m);
      behind_m = std::max(behind_m, across_m);
      reaches_half_plane |= aside_m > -b.bulge_m;
      const double rad = std::atan2(std::max(aside_m, 0.0), -viewpoint_.center.dot(p));
      first_rad = std::min(first_rad, rad);
      last_rad = std::max(last_rad, rad);
    }
    if (!reaches_half_plane || before_m > b.bulge_m || behind_m < -b.bulge_m) return 0;
    const double radius_m = kMoonRadius_m + b.high_m, beside_rad = 2 * b.bulge_m / (kMoonRadius_m + b.low_m);
    const double limb_rad = std::acos(std::min(1.0, radius_m / viewpoint_.distance_m));
    const double rad = std::clamp(limb_rad, std::max(0.0, first_rad - beside_rad), last_rad + beside_rad);
    return viewpoint_.angle_rad(-radius_m * std::cos(rad), radius_m * std::sin(rad));
  }

  // Returns bounds from the block's own heights. Empty without data, or if the block is too low to contain the limb.
  std::optional<NodeBounds> measured(const BlockId& id) const {
    const int posts_level = terrain_.posts_level(id);
    if (id.level > posts_level) return bounds_from_posts(id, dem::ancestor_of(id, posts_level));
    const auto matters = [&](const NodeBounds& b) { return upper_rad(b) > best_rad_; };
    if (!may_matter(terrain_, id, stop_, matters)) return std::nullopt;
    const auto node = bounded_node(terrain_, id, stop_);
    return node ? std::optional(node->bounds) : std::nullopt;
  }

  // Returns bounds of a block finer than the posts: it lies between the heights of the posts around it.
  std::optional<NodeBounds> bounds_from_posts(const BlockId& id, const BlockId& posts_id) const {
    const auto posts = terrain_.block(posts_id, stop_);
    if (!posts) return std::nullopt;
    const dem::BlockExtent e = dem::extent_of(id), &parent = posts->extent;
    const int last_r = std::min(parent.quads, dem::steps_in(e.lat1() - parent.lat0 - 1, parent.lat_step) + 1),
              last_c = std::min(parent.quads, dem::steps_in(e.lon1() - parent.lon0 - 1, parent.lon_step) + 1);
    float low = dem::kHighestRelief_m, high = dem::kLowestRelief_m;
    for (int r = dem::steps_in(e.lat0 - parent.lat0, parent.lat_step); r <= last_r; ++r)
      for (int c = dem::steps_in(e.lon0 - parent.lon0, parent.lon_step); c <= last_c; ++c) {
        const float h = posts->vertices[posts->index(r, c)].height_m;
        if (std::isnan(h)) continue;
        low = std::min(low, h);
        high = std::max(high, h);
      }
    if (low > high) return std::nullopt;
    return bounds_of(id, static_cast<double>(low), static_cast<double>(high));
  }

  static constexpr double kOnPlane_m = 1e-6;
  static constexpr unsigned kBothSides = 3;
  // Returns the sides of the plane that a vertex is on, one bit each. A vertex on the plane to within rounding is on
  // both sides, as posts of a meridian in the plane are: otherwise two neighbouring triangles could each leave the edge
  // to the other.
  static unsigned sides_of(double across_m, double tolerance_m) {
    return (across_m >= -tolerance_m ? 1U : 0U) | (across_m <= tolerance_m ? 2U : 0U);
  }

  // Intersects the triangles of a block with the half plane.
  void cut(const BlockId& id) {
    const auto block = terrain_.block(id, stop_);
    if (!block) return;
    const int quads = block->extent.quads, last = quads - 1;
    dem::FinestEdges edges(terrain_, *block, stop_);
    // Skip quads on one side of the plane. The plane contains the Moon's centre, so a vertex's side does not depend on
    // its height, except for rounding: allow twice as much here as for the triangles.
    std::vector<unsigned> sides(block->vertices.size());
    for (int r = 0; r <= quads; ++r)
      for (int c = 0; c <= quads; ++c)
        sides[block->index(r, c)] = sides_of(normal_.dot(block->position(r, c, 0)), 2 * kOnPlane_m);
    for (int r = 0; r < quads; ++r)
      for (int c = 0; c < quads; ++c) {
        const unsigned quad_sides = sides[block->index(r, c)] | sides[block->index(r, c + 1)] |
                                    sides[block->index(r + 1, c)] | sides[block->index(r + 1, c + 1)];
        const bool on_edge = r == 0 || c == 0 || r == last || c == last;
        if (quad_sides != kBothSides && !(on_edge && edges.differ())) continue;
        for (const bool upper : {false, true}) cut(edges, dem::vertices_of(r, c, upper));
      }
  }

  // Intersects the edges of a triangle with the half plane and keeps the largest angle.
  void cut(dem::FinestEdges& edges, const dem::QuadVertices& q) {
    Vec3 v[3];
    double across_m[3];
    for (int i = 0; i < 3; ++i) {
      v[i] = edges.vertex(q.r[i], q.c[i]);
      if (std::isnan(v[i].x())) return;
      across_m[i] = normal_.dot(v[i]);
    }
    for (int i = 0; i < 3; ++i) {
      const int j = (i + 1) % 3;
      if ((sides_of(across_m[i], kOnPlane_m) | sides_of(across_m[j], kOnPlane_m)) != kBothSides) continue;
      const bool starts_on_plane = std::abs(across_m[i]) <= kOnPlane_m;
      const double t = starts_on_plane ? 0 : std::clamp(across_m[i] / (across_m[i] - across_m[j]), 0.0, 1.0);
      const Vec3 point = v[i] + t * (v[j] - v[i]);
      if (aside_.dot(point) < 0) continue;
      const double angle = viewpoint_.angle_rad(viewpoint_.center.dot(point), aside_.dot(point));
      if (angle > best_rad_) {
        best_rad_ = angle;
        position_m_ = point;
      }
    }
  }

  // Returns whether there is data below the line of sight to the limb at 33 points between its entry into and its exit
  // from the shell of the highest terrain.
  bool has_data_below() const {
    constexpr int kIntervals = 32, kCoarse = 8;
    const Vec3 along = std::cos(best_rad_) * viewpoint_.center + std::sin(best_rad_) * aside_;
    const double closest_m = -viewpoint_.from_m.dot(along), height_m = (viewpoint_.from_m + closest_m * along).norm(),
                 half_m = std::sqrt(std::max(0.0, kHighest_m * kHighest_m - height_m * height_m));
    const double first_m = std::max(0.0, closest_m - half_m), last_m = closest_m + half_m;
    for (int k = 0; k <= kIntervals; ++k) {
      const Geographic g = to_geographic(viewpoint_.from_m + (first_m + (last_m - first_m) * k / kIntervals) * along);
      const int posts = terrain_.plain().posts_level(dem::block_at_place(dem::kMaxLevel, g.lat_deg, g.lon_deg));
      if (!dem::surface_at(terrain_.plain(), g.lat_deg, g.lon_deg, std::min(kCoarse, posts), stop_)) return false;
    }
    return true;
  }

  const Viewpoint& viewpoint_;
  const Vec3 aside_, normal_;  // unit: in the half plane across `center`; normal to the half plane
  const dem::Terrain& terrain_;
  const StopToken& stop_;
  std::priority_queue<Candidate> candidates_;
  double best_rad_ = 0;
  Vec3 position_m_ = Vec3::zero();
};

// Returns the root blocks that may reach the limb. Terrain hides nothing nearer than the limb of the sphere below all
// terrain, and the highest peak shows up to a certain angle beyond it.
std::vector<LimbSearch::Root> roots_at_limb(const Viewpoint& viewpoint, const dem::Terrain& terrain) {
  const double reach_rad =
      std::acos(std::min(1.0, dem::kCoreRadius_m / viewpoint.distance_m)) + std::acos(dem::kCoreRadius_m / kHighest_m);
  std::vector<LimbSearch::Root> roots;
  for (const BlockId& id : terrain.roots()) {
    LimbSearch::Root root{id, loose_bounds(id)};
    const Vec3& centre = root.loose.centre;
    const double to_centre_rad = std::acos(std::clamp(-viewpoint.center.dot(centre) / centre.norm(), -1.0, 1.0));
    if (to_centre_rad < reach_rad + std::asin(std::min(1.0, root.loose.radius_m / centre.norm())))
      roots.push_back(std::move(root));
  }
  return roots;
}

// Returns whether a pixel position is in the image.
bool is_in_image(const Camera& camera, double x_px, double y_px) {
  return x_px >= -0.5 && y_px >= -0.5 && x_px < camera.width - 0.5 && y_px < camera.height - 0.5;
}

// Returns the limb of the sphere at an azimuth; none from inside it.
LimbPoint limb_of_sphere(const Viewpoint& viewpoint, const View& view, double azimuth_rad) {
  LimbPoint point;
  point.azimuth_deg = azimuth_rad * kDegreesPerRadian;
  if (viewpoint.distance_m <= kMoonRadius_m) return point;
  const double angle = viewpoint.limb_rad(kMoonRadius_m);
  point.sphere_angle_deg = angle * kDegreesPerRadian;
  const Vec3 along = std::cos(angle) * viewpoint.center + std::sin(angle) * viewpoint.aside(azimuth_rad);
  if (const auto pixel = view.project(viewpoint.from_m + viewpoint.to_limb_m() * along)) {
    point.sphere_x_px = pixel->x;
    point.sphere_y_px = pixel->y;
  }
  return point;
}

// Returns the terminator of the sphere at an azimuth about the subsolar point, from north to east.
TerminatorPoint terminator_of_sphere(const Viewpoint& sun, const View& view, double azimuth_rad) {
  TerminatorPoint point;
  point.azimuth_deg = azimuth_rad * kDegreesPerRadian;
  const double angle = sun.limb_rad(kMoonRadius_m);
  // A sunray that touches the sphere is perpendicular to the radius there: the radius leans toward the Sun (away from
  // `center`) by the angle at the Sun.
  const Vec3 ground_m = kMoonRadius_m * (std::cos(angle) * sun.aside(azimuth_rad) - std::sin(angle) * sun.center);
  if (const auto pixel = view.project(ground_m)) {
    point.sphere_x_px = pixel->x;
    point.sphere_y_px = pixel->y;
    point.sphere_visible =
        is_in_image(view.camera(), pixel->x, pixel->y) && (view.position() - ground_m).dot(ground_m) > 0;
  }
  return point;
}

// Searches the limb at evenly spaced azimuths, in parallel, and calls on_searched(i, azimuth_rad, search) for each,
// also without a limb.
template <typename OnSearched>
void search_all(const Viewpoint& viewpoint, int azimuth_count, const dem::Terrain& terrain, const StopToken& stop,
                const OnSearched& on_searched) {
  const std::vector<LimbSearch::Root> roots = roots_at_limb(viewpoint, terrain);
  const auto search_at = [&](std::size_t i) {
    const double azimuth_rad = 2 * std::numbers::pi * static_cast<double>(i) / azimuth_count;
    LimbSearch search(viewpoint, azimuth_rad, terrain, stop);
    search.search(roots);
    on_searched(i, azimuth_rad, search);
  };
  in_parallel(static_cast<std::size_t>(azimuth_count), search_at);
}

}  // namespace

std::vector<LimbPoint> find_limb(const LimbRequest& request, const RenderContext& context) {
  const RowViews views(request.camera, request.pose, std::nullopt, context.stop);
  refuse_underground(context.terrain, views, context.stop);
  const View& view = views.reference();
  const Viewpoint viewpoint(view);
  std::vector<LimbPoint> points(static_cast<std::size_t>(request.points));
  search_all(viewpoint, request.points, context.terrain, context.stop,
             [&](std::size_t i, double azimuth_rad, const LimbSearch& search) {
               LimbPoint& point = points[i] = limb_of_sphere(viewpoint, view, azimuth_rad);
               if (!search.found()) return;
               point.angle_deg = search.angle_rad() * kDegreesPerRadian;
               point.position_m = search.position_m();
               point.range_m = (point.position_m - viewpoint.from_m).norm();
               const auto pixel = view.project(point.position_m);
               if (!pixel) return;
               point.x_px = pixel->x;
               point.y_px = pixel->y;
               point.in_frame = is_in_image(view.camera(), pixel->x, pixel->y);
             });
  return points;
}

std::vector<TerminatorPoint> find_terminator(const LimbRequest& request, const RenderContext& context) {
  if (!request.sun) return {};
  const View view(request.camera, request.pose);
  const Viewpoint sun(*request.sun);
  std::vector<TerminatorPoint> points(static_cast<std::size_t>(request.points));
  search_all(sun, request.points, context.terrain, context.stop,
             [&](std::size_t i, double azimuth_rad, const LimbSearch& search) {
               points[i] = terminator_of_sphere(sun, view, azimuth_rad);
               if (search.found()) points[i].position_m = search.position_m();
             });
  std::vector<LandmarkQuery> landmarks;
  std::vector<TerminatorPoint*> landmark_points;
  for (TerminatorPoint& point : points) {
    if (!point.known()) continue;
    const Geographic g = to_geographic(point.position_m);
    landmarks.push_back({g.lat_deg, g.lon_deg, g.height_m});
    landmark_points.push_back(&point);
  }
  // Without a shutter, objects and the Sun: only pixel and visibility are needed.
  const std::vector<Landmark> sightings =
      project_landmarks(request.camera, request.pose, std::nullopt, landmarks, {}, std::nullopt, context);
  for (std::size_t k = 0; k < sightings.size(); ++k) {
    TerminatorPoint& point = *landmark_points[k];
    point.x_px = sightings[k].x_px;
    point.y_px = sightings[k].y_px;
    point.in_frame = sightings[k].in_frame;
    point.visible = sightings[k].visible;
  }
  return points;
}

}  // namespace selenograph::engine
