#include "engine/limb/limb_in_view.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <queue>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/grid/surface.h"
#include "dem/terrain/build_queue.h"
#include "dem/terrain/finest_surface.h"
#include "dem/terrain/surface_place.h"
#include "engine/camera/row_views.h"
#include "engine/rays/ray_queries.h"
#include "engine/scene/known_nodes.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {
namespace {

using dem::BlockId;

constexpr double kHighest_m = kMoonRadius_m + double{dem::kHighestRelief_m};

// A camera and the direction to the Moon's centre. A half plane of an azimuth begins at the line between the two, so
// that a place in it has two coordinates: `ahead_m` along that line and `aside_m` across it.
struct Outlook {
  explicit Outlook(const View& view)
      : from_m(view.position()), distance_m(from_m.norm()), center(-from_m / distance_m) {
    const auto turn = Eigen::Quaterniond::FromTwoVectors(view.moon_from_camera().col(2), center);
    right = turn * view.moon_from_camera().col(0);
    down = turn * view.moon_from_camera().col(1);
  }
  // From the Sun; azimuths from north to east.
  explicit Outlook(const Sun& sun)
      : from_m(sun.distance_au * kAstronomicalUnit_m * sun.direction),
        distance_m(from_m.norm()),
        center(-sun.direction) {
    const EastNorthUp axes = local_axes(sun.direction);
    right = axes.north;
    down = axes.east;
  }

  Vec3 aside(double azimuth_rad) const { return std::cos(azimuth_rad) * right + std::sin(azimuth_rad) * down; }
  // From the Moon's centre, seen from the camera.
  double angle_rad(double ahead_m, double aside_m) const { return std::atan2(aside_m, distance_m + ahead_m); }
  // Of the limb of a sphere; straight up from within it.
  double limb_rad(double radius_m) const {
    return radius_m < distance_m ? std::asin(radius_m / distance_m) : std::numbers::pi;
  }
  double to_limb_m() const { return std::sqrt(std::max(distance_m * distance_m - kMoonRadius_m * kMoonRadius_m, 1e6)); }

  Vec3 from_m;
  double distance_m;
  Vec3 center, right, down;  // unit, normal to each other
};

// The terrain's limb in a half plane: the largest angle from the Moon's centre of all triangles that the plane cuts. It
// cuts a straight line out of each, whose larger angle is at an end: on an edge of the triangle. The blocks are taken
// in falling order of upper bounds on their angles, which follow from bounds on their heights, until none is above the
// largest angle found.
class LimbSearch {
 public:
  LimbSearch(const Outlook& outlook, double azimuth_rad, const dem::Terrain& terrain, const StopToken& stop)
      : outlook_(outlook),
        aside_(outlook.aside(azimuth_rad)),
        normal_(outlook.center.cross(aside_)),
        terrain_(terrain),
        stop_(stop) {}

  struct Root {
    BlockId id;
    NodeBounds loose;
  };
  void among(const std::vector<Root>& roots) {
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

  bool found() const { return best_rad_ > 0 && data_below(); }
  double angle_rad() const { return best_rad_; }
  const Vec3& position_m() const { return position_m_; }

 private:
  struct Candidate {
    double upper_rad;
    BlockId id;
    bool measured;  // the bound is of its own heights
    bool operator<(const Candidate& other) const {
      return std::pair(upper_rad, other.id) < std::pair(other.upper_rad, id);
    }
  };
  void add(const BlockId& id, double upper_rad, bool measured) {
    if (upper_rad > best_rad_) candidates_.push({upper_rad, id, measured});
  }

  // Seen from the Moon's centre the block lies between two directions of the plane. The angle at the camera grows with
  // the radius; with the direction it grows up to the limb of the sphere of that radius and falls beyond it. 0: the
  // half plane does not cut the block.
  double upper_rad(const NodeBounds& b) const {
    if (std::abs(normal_.dot(b.centre)) > b.radius_m || aside_.dot(b.centre) < -b.radius_m) return 0;
    double before_m = std::numeric_limits<double>::infinity(), behind_m = -before_m;
    double first_rad = std::numbers::pi, last_rad = 0;
    bool any = false;
    for (const Vec3& p : b.points) {
      const double across_m = normal_.dot(p), aside_m = aside_.dot(p);
      before_m = std::min(before_m, across_m);
      behind_m = std::max(behind_m, across_m);
      any |= aside_m > -b.bulge_m;
      const double rad = std::atan2(std::max(aside_m, 0.0), -outlook_.center.dot(p));
      first_rad = std::min(first_rad, rad);
      last_rad = std::max(last_rad, rad);
    }
    if (!any || before_m > b.bulge_m || behind_m < -b.bulge_m) return 0;
    const double radius_m = kMoonRadius_m + b.high_m, beside_rad = 2 * b.bulge_m / (kMoonRadius_m + b.low_m);
    const double limb_rad = std::acos(std::min(1.0, radius_m / outlook_.distance_m));
    const double rad = std::clamp(limb_rad, std::max(0.0, first_rad - beside_rad), last_rad + beside_rad);
    return outlook_.angle_rad(-radius_m * std::cos(rad), radius_m * std::sin(rad));
  }

  // Empty: no data, or too low to matter.
  std::optional<NodeBounds> measured(const BlockId& id) const {
    const int posts_level = terrain_.posts_level(id);
    if (id.level > posts_level) return of_posts(id, dem::ancestor_of(id, posts_level));
    const auto matters = [&](const NodeBounds& b) { return upper_rad(b) > best_rad_; };
    if (!may_matter(terrain_, id, stop_, matters)) return std::nullopt;
    const auto node = known(terrain_, id, stop_);
    return node ? std::optional(node->bounds) : std::nullopt;
  }

  // A block between posts lies between the heights of those around it.
  std::optional<NodeBounds> of_posts(const BlockId& id, const BlockId& posts_id) const {
    const auto posts = terrain_.block(posts_id, stop_);
    if (!posts) return std::nullopt;
    const dem::BlockExtent e = dem::extent_of(id), &of = posts->extent;
    const int last_r = std::min(of.quads, (e.lat1() - of.lat0 - 1) / of.lat_step + 1),
              last_c = std::min(of.quads, (e.lon1() - of.lon0 - 1) / of.lon_step + 1);
    float low = dem::kHighestRelief_m, high = dem::kLowestRelief_m;
    for (int r = (e.lat0 - of.lat0) / of.lat_step; r <= last_r; ++r)
      for (int c = (e.lon0 - of.lon0) / of.lon_step; c <= last_c; ++c)
        if (const float h = posts->vertices[posts->index(r, c)].height_m; !std::isnan(h))
          low = std::min(low, h), high = std::max(high, h);
    if (low > high) return std::nullopt;
    return bounds_of(id, static_cast<double>(low), static_cast<double>(high));
  }

  // On which sides of the plane a vertex counts: on both where rounding decides, as with posts of a meridian that lies
  // in the plane. Else two neighbours could each leave its edge to the other.
  static constexpr double kOnPlane_m = 1e-6;
  static constexpr unsigned kBothSides = 3;
  static unsigned sides_of(double across_m, double tolerance_m) {
    return (across_m >= -tolerance_m ? 1U : 0U) | (across_m <= tolerance_m ? 2U : 0U);
  }

  void cut(const BlockId& id) {
    const auto block = terrain_.block(id, stop_);
    if (!block) return;
    const int quads = block->extent.quads, last = quads - 1;
    const dem::FinestEdges edges(terrain_, *block, {0, last, 0, last}, stop_);
    // The plane goes through the Moon's centre: on which side of it a vertex is does not depend on its height but for
    // rounding, twice as much of which is allowed for.
    std::vector<unsigned> sides(block->vertices.size());
    for (int r = 0; r <= quads; ++r)
      for (int c = 0; c <= quads; ++c)
        sides[block->index(r, c)] = sides_of(normal_.dot(block->position(r, c, 0)), 2 * kOnPlane_m);
    for (int r = 0; r < quads; ++r)
      for (int c = 0; c < quads; ++c) {
        const unsigned of_quad = sides[block->index(r, c)] | sides[block->index(r, c + 1)] |
                                 sides[block->index(r + 1, c)] | sides[block->index(r + 1, c + 1)];
        const bool on_edge = r == 0 || c == 0 || r == last || c == last;
        if (of_quad != kBothSides && !(on_edge && edges.differ())) continue;
        for (const bool upper : {false, true}) cut(edges, dem::vertices_of(r, c, upper));
      }
  }

  void cut(const dem::FinestEdges& edges, const dem::QuadVertices& q) {
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
      const bool begins_there = std::abs(across_m[i]) <= kOnPlane_m;
      const double t = begins_there ? 0 : std::clamp(across_m[i] / (across_m[i] - across_m[j]), 0.0, 1.0);
      const Vec3 place = v[i] + t * (v[j] - v[i]);
      if (aside_.dot(place) < 0) continue;
      const double angle = outlook_.angle_rad(outlook_.center.dot(place), aside_.dot(place));
      if (angle > best_rad_) {
        best_rad_ = angle;
        position_m_ = place;
      }
    }
  }

  // Whether there is data below the line of sight to the limb wherever that is below the highest terrain.
  bool data_below() const {
    constexpr int kPlaces = 32, kCoarse = 8;
    const Vec3 along = std::cos(best_rad_) * outlook_.center + std::sin(best_rad_) * aside_;
    const double closest_m = -outlook_.from_m.dot(along), height_m = (outlook_.from_m + closest_m * along).norm(),
                 half_m = std::sqrt(std::max(0.0, kHighest_m * kHighest_m - height_m * height_m));
    const double first_m = std::max(0.0, closest_m - half_m), last_m = closest_m + half_m;
    for (int k = 0; k <= kPlaces; ++k) {
      const Geographic g = to_geographic(outlook_.from_m + (first_m + (last_m - first_m) * k / kPlaces) * along);
      const int posts = terrain_.plain().posts_level(dem::block_at_place(dem::kMaxLevel, g.lat_deg, g.lon_deg));
      if (!dem::surface_at(terrain_.plain(), g.lat_deg, g.lon_deg, std::min(kCoarse, posts), stop_)) return false;
    }
    return true;
  }

  const Outlook& outlook_;
  const Vec3 aside_, normal_;  // unit: within the half plane, and of it
  const dem::Terrain& terrain_;
  const StopToken& stop_;
  std::priority_queue<Candidate> candidates_;
  double best_rad_ = 0;
  Vec3 position_m_ = Vec3::Zero();
};

// Blocks that may be as far out as the limb of a sphere below all terrain.
std::vector<LimbSearch::Root> roots_at_limb(const Outlook& outlook, const dem::Terrain& terrain) {
  const double reach_rad =
      std::acos(std::min(1.0, dem::kCoreRadius_m / outlook.distance_m)) + std::acos(dem::kCoreRadius_m / kHighest_m);
  std::vector<LimbSearch::Root> roots;
  for (const BlockId& id : terrain.roots()) {
    LimbSearch::Root root{id, loose_bounds(id)};
    const Vec3& centre = root.loose.centre;
    const double to_centre_rad = std::acos(std::clamp(-outlook.center.dot(centre) / centre.norm(), -1.0, 1.0));
    if (to_centre_rad < reach_rad + std::asin(std::min(1.0, root.loose.radius_m / centre.norm())))
      roots.push_back(std::move(root));
  }
  return roots;
}

bool within(const Camera& camera, double x_px, double y_px) {
  return x_px >= -0.5 && y_px >= -0.5 && x_px < camera.width - 0.5 && y_px < camera.height - 0.5;
}

LimbPoint limb_of_sphere(const Outlook& outlook, const View& view, double azimuth_rad) {
  LimbPoint point;
  point.azimuth_deg = azimuth_rad * kDegreesPerRadian;
  if (outlook.distance_m <= kMoonRadius_m) return point;
  const double angle = outlook.limb_rad(kMoonRadius_m);
  point.sphere_angle_deg = angle * kDegreesPerRadian;
  const Vec3 along = std::cos(angle) * outlook.center + std::sin(angle) * outlook.aside(azimuth_rad);
  if (const auto pixel = view.project(outlook.from_m + outlook.to_limb_m() * along))
    point.sphere_x_px = pixel->x, point.sphere_y_px = pixel->y;
  return point;
}

// From the middle between day and night on the sphere.
TerminatorPoint terminator_of_sphere(const Outlook& sun, const View& view, double azimuth_rad) {
  TerminatorPoint point;
  point.azimuth_deg = azimuth_rad * kDegreesPerRadian;
  const double angle = sun.limb_rad(kMoonRadius_m);
  const Vec3 place = kMoonRadius_m * (std::cos(angle) * sun.aside(azimuth_rad) - std::sin(angle) * sun.center);
  if (const auto pixel = view.project(place)) {
    point.sphere_x_px = pixel->x;
    point.sphere_y_px = pixel->y;
    point.sphere_visible = within(view.camera(), pixel->x, pixel->y) && (view.position() - place).dot(place) > 0;
  }
  return point;
}

// Calls found(i, azimuth, search) for each of some azimuths.
template <typename Found>
void search_all(const Outlook& outlook, int azimuths, const dem::Terrain& terrain, const StopToken& stop,
                const Found& found) {
  const std::vector<LimbSearch::Root> roots = roots_at_limb(outlook, terrain);
  const auto search_at = [&](std::size_t i) {
    const double azimuth_rad = 2 * std::numbers::pi * static_cast<double>(i) / azimuths;
    LimbSearch search(outlook, azimuth_rad, terrain, stop);
    search.among(roots);
    found(i, azimuth_rad, search);
  };
  const auto all = [&] { in_parallel(static_cast<std::size_t>(azimuths), search_at); };
  if (std::any_of(roots.begin(), roots.end(), [&](const auto& root) { return terrain.waits_for_network(root.id); }))
    on_own_threads(dem::kNetworkReaders, all);
  else
    all();
}

}  // namespace

std::vector<LimbPoint> find_limb(const LimbRequest& request, const dem::Terrain& terrain, const StopToken& stop) {
  const RowViews views(request.camera, request.pose, std::nullopt, stop);
  refuse_underground(terrain, views, stop);
  const View& view = views.reference();
  const Outlook outlook(view);
  std::vector<LimbPoint> points(static_cast<std::size_t>(request.points));
  search_all(outlook, request.points, terrain, stop, [&](std::size_t i, double azimuth_rad, const LimbSearch& search) {
    LimbPoint& point = points[i] = limb_of_sphere(outlook, view, azimuth_rad);
    if (!search.found()) return;
    point.angle_deg = search.angle_rad() * kDegreesPerRadian;
    point.position_m = search.position_m();
    point.range_m = (point.position_m - outlook.from_m).norm();
    const auto pixel = view.project(point.position_m);
    if (!pixel) return;
    point.x_px = pixel->x;
    point.y_px = pixel->y;
    point.in_frame = within(view.camera(), pixel->x, pixel->y);
  });
  return points;
}

std::vector<TerminatorPoint> find_terminator(const LimbRequest& request, const dem::Terrain& terrain, RenderCache& kept,
                                             const StopToken& stop) {
  if (!request.sun) return {};
  const View view(request.camera, request.pose);
  const Outlook sun(*request.sun);
  std::vector<TerminatorPoint> points(static_cast<std::size_t>(request.points));
  search_all(sun, request.points, terrain, stop, [&](std::size_t i, double azimuth_rad, const LimbSearch& search) {
    points[i] = terminator_of_sphere(sun, view, azimuth_rad);
    if (search.found()) points[i].position_m = search.position_m();
  });
  std::vector<LandmarkQuery> places;
  std::vector<TerminatorPoint*> of_places;
  for (TerminatorPoint& point : points) {
    if (!point.known()) continue;
    const Geographic g = to_geographic(point.position_m);
    places.push_back({g.lat_deg, g.lon_deg, g.height_m});
    of_places.push_back(&point);
  }
  const std::vector<Landmark> seen =
      project_landmarks(request.camera, request.pose, std::nullopt, places, {}, std::nullopt, terrain, kept, stop);
  for (std::size_t k = 0; k < seen.size(); ++k) {
    TerminatorPoint& point = *of_places[k];
    point.x_px = seen[k].x_px;
    point.y_px = seen[k].y_px;
    point.in_frame = seen[k].in_frame;
    point.visible = seen[k].visible;
  }
  return points;
}

}  // namespace selenograph::engine
