#include "engine/visibility/objects/rock_shapes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "dem/base/parallel.h"
#include "dem/detail/size_cells.h"
#include "dem/grid/rotation.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

// Radius at which a fillet touches its rock, in radii of the fillet.
constexpr double kContactRadius = 0.7;

struct Sphere {
  std::vector<Vec3> corners;
  std::vector<ObjectTriangle> triangles;
};

// Returns an icosahedron on the unit sphere whose triangles are cut into four, `cuts` times.
Sphere subdivided_icosahedron(int cuts) {
  const double phi = std::numbers::phi;
  Sphere sphere{{{-1, phi, 0},
                 {1, phi, 0},
                 {-1, -phi, 0},
                 {1, -phi, 0},
                 {0, -1, phi},
                 {0, 1, phi},
                 {0, -1, -phi},
                 {0, 1, -phi},
                 {phi, 0, -1},
                 {phi, 0, 1},
                 {-phi, 0, -1},
                 {-phi, 0, 1}},
                {}};
  constexpr std::array<std::array<std::uint32_t, 3>, 20> kFaces{
      {{0, 11, 5},  {0, 5, 1},  {0, 1, 7},  {0, 7, 10}, {0, 10, 11}, {1, 5, 9}, {5, 11, 4},
       {11, 10, 2}, {10, 7, 6}, {7, 1, 8},  {3, 9, 4},  {3, 4, 2},   {3, 2, 6}, {3, 6, 8},
       {3, 8, 9},   {4, 9, 5},  {2, 4, 11}, {6, 2, 10}, {8, 6, 7},   {9, 8, 1}}};
  for (const auto& face : kFaces) sphere.triangles.push_back({face, 0});
  for (int i = 0; i < cuts; ++i) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> midpoints;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [at, is_new] =
          midpoints.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(sphere.corners.size()));
      if (is_new) sphere.corners.push_back(sphere.corners[a] + sphere.corners[b]);
      return at->second;
    };
    std::vector<ObjectTriangle> finer;
    for (const ObjectTriangle& t : sphere.triangles) {
      const auto [a, b, c] = t.corner;
      const std::uint32_t ab = middle(a, b);
      const std::uint32_t bc = middle(b, c);
      const std::uint32_t ca = middle(c, a);
      for (const auto& face : {std::array{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}})
        finer.push_back({face, 0});
    }
    sphere.triangles = std::move(finer);
    for (Vec3& corner : sphere.corners) corner.normalize();
  }
  return sphere;
}

// Returns a direction, uniform on the sphere.
Vec3 random_direction(dem::Draws& draws) {
  const double z = 2 * draws.uniform() - 1;
  const double turn = 2 * pi * draws.uniform();
  const double around = std::sqrt(1 - z * z);
  return {around * std::cos(turn), around * std::sin(turn), z};
}

// Per rounding (sharp, chipped, rounded edges), the power of the mean that joins the planes of a stone, and the
// roughness. Power 0 takes the minimum of the planes' distances, others a smooth approximation: the lower, the rounder.
// At 18 edges are rounded, and facets remain.
constexpr std::array<double, kRoundings> kPowers{0, 40, 18}, kRoughness{0.012, 0.018, 0.025};

// Roughness of the surface of a stone: a sum of waves in random directions, shorter ones with smaller amplitudes.
class Waves {
 public:
  explicit Waves(dem::Draws& draws) {
    for (std::size_t i = 0; i < kWaves; ++i) {
      along_[i] = (4 + 3 * static_cast<double>(i)) * random_direction(draws);
      phase_[i] = 2 * pi * draws.uniform();
    }
  }
  double at(const Vec3& direction) const {
    double sum = 0;
    for (std::size_t i = 0; i < kWaves; ++i)
      sum += std::sin(along_[i].dot(direction) + phase_[i]) / (2.0 + 1.5 * static_cast<double>(i));
    return sum;
  }

 private:
  static constexpr std::size_t kWaves = 6;
  std::array<Vec3, kWaves> along_;
  std::array<double, kWaves> phase_;
};

// Adds normals for shading: per corner of a triangle, the mean of the facets around it that are within 30 degrees of
// the triangle. Faces are then smooth, and edges stay sharp. Each triangle gets corners of its own.
ObjectShape with_edge_normals(const std::vector<Vec3>& points, const std::vector<ObjectTriangle>& triangles) {
  const double min_cosine = std::cos(30 * kRadiansPerDegree);
  std::vector<Vec3> facets;
  std::vector<std::vector<std::size_t>> around(points.size());
  for (const ObjectTriangle& t : triangles) {
    for (const std::uint32_t corner : t.corner) around[corner].push_back(facets.size());
    const auto [a, b, c] = t.corner;
    facets.push_back((points[b] - points[a]).cross(points[c] - points[a]));
  }
  ObjectShape out;
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    ObjectTriangle split_triangle{{}, 0};
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t corner = triangles[i].corner[k];
      Vec3 normal = Vec3::zero();
      for (const std::size_t neighbour : around[corner])
        if (facets[i].dot(facets[neighbour]) >= min_cosine * facets[i].norm() * facets[neighbour].norm())
          normal += facets[neighbour];
      split_triangle.corner[k] = static_cast<std::uint32_t>(out.corners.size());
      out.corners.push_back({points[corner].cast<float>(), normal.normalized().cast<float>()});
    }
    out.triangles.push_back(split_triangle);
  }
  return out;
}

// Planes that cut a stone, each by its normal over its distance from the middle: a point p is outside if the dot
// product exceeds 1.
constexpr std::size_t kPlanes = 16;
using CuttingPlanes = std::array<Vec3, kPlanes>;

// Returns random planes at 0.5 to 0.85 of the unit ball's radius. Each is the farthest of some from those before it:
// where planes leave a gap, the ball shows.
CuttingPlanes cutting_planes(dem::Draws& draws) {
  constexpr int kCandidates = 6;
  CuttingPlanes normals, planes;
  for (std::size_t i = 0; i < kPlanes; ++i) {
    double smallest_cosine = 2;
    for (int k = 0; k < kCandidates; ++k) {
      const Vec3 candidate = random_direction(draws);
      double cosine = -1;  // to the nearest normal so far
      for (std::size_t j = 0; j < i; ++j) cosine = std::max(cosine, normals[j].dot(candidate));
      if (cosine >= smallest_cosine) continue;
      smallest_cosine = cosine;
      normals[i] = candidate;
    }
    planes[i] = normals[i] / (0.5 + 0.35 * draws.uniform());
  }
  return planes;
}

// Returns a direction on the edge between the two planes that it meets first, if that is nearer than half a side of the
// ball's triangles: triangles then do not cross edges, which would be saw-toothed. Else returns the direction.
Vec3 moved_to_edge(const CuttingPlanes& planes, const Vec3& direction) {
  constexpr double kFarthest = 0.065;
  const auto farther = [&](const Vec3& a, const Vec3& b) { return a.dot(direction) < b.dot(direction); };
  const auto first = std::max_element(planes.begin(), planes.end(), farther);
  if (first->dot(direction) <= 1) return direction;
  auto second = first == planes.begin() ? planes.begin() + 1 : planes.begin();
  for (auto plane = planes.begin(); plane != planes.end(); ++plane)
    if (plane != first && farther(*second, *plane)) second = plane;
  const Vec3 difference = *first - *second;
  const double ahead = difference.dot(direction);
  const Vec3 across = difference - ahead * direction;
  const Vec3 step = -ahead / across.squared_norm() * across;
  return step.norm() < kFarthest ? (direction + step).normalized() : direction;
}

// Returns a stone: a ball cut by random planes, with a rough surface.
ObjectShape stone(std::size_t number, std::size_t rounding) {
  constexpr std::uint64_t kRockShapes = 0x726f636b;  // seed: "rock" in ASCII
  dem::Draws draws(kRockShapes, 0, static_cast<int>(number), 0);
  const Sphere sphere = subdivided_icosahedron(3);
  const CuttingPlanes planes = cutting_planes(draws);
  const Waves waves(draws);
  const double power = kPowers[rounding], roughness = kRoughness[rounding];
  std::vector<Vec3> points;
  for (const Vec3& corner : sphere.corners) {
    const Vec3 direction = moved_to_edge(planes, corner);
    // Both begin with the unit sphere around the planes, whose distance is 1.
    double sum = 1, nearest = 1;
    for (const Vec3& plane : planes) {
      const double inverse_distance = plane.dot(direction);
      if (inverse_distance <= 0) continue;
      nearest = std::min(nearest, 1 / inverse_distance);
      sum += std::pow(inverse_distance, power);
    }
    const double radius = (power > 0 ? std::pow(sum, -1 / power) : nearest) * (1 + roughness * waves.at(direction));
    points.emplace_back(radius * direction);
  }
  ObjectShape out = with_edge_normals(points, sphere.triangles);
  out.parts = {"rock"};
  return out;
}

// The soil against a rock: its height by position, x and y in radii of the fillet, heights in those of its side.
//
//        rock |\            The side's height differs by azimuth, from a tenth to 1.4. The slope is that of loose soil
//             | `-.__       all around: where the side is low, the fillet is narrow. Lumps like those of the ground lie
//   __________|__0.7_`-.__  on it, and its edge is in the ground.
class Mound {
 public:
  explicit Mound(dem::Draws& draws) {
    for (double& phase : phases_) phase = 2 * pi * draws.uniform();
    for (Lump& lump : lumps_) {
      const double radius = 0.5 + 0.5 * std::sqrt(draws.uniform());
      const double azimuth = 2 * pi * draws.uniform();
      lump = {radius * std::cos(azimuth), radius * std::sin(azimuth), 0.035 + 0.05 * std::pow(draws.uniform(), 2)};
    }
  }

  double height(double x, double y) const {
    const double azimuth = std::atan2(y, x);
    double side = 0.75;
    for (std::size_t i = 0; i < phases_.size(); ++i)
      side += 0.35 / static_cast<double>(i + 1) * std::cos(static_cast<double>(i + 1) * azimuth + phases_[i]);
    side = std::clamp(side, 0.1, 1.4);
    const double edge = 0.8 + 0.2 * side;  // radius
    const double share = (edge - std::hypot(x, y)) / (edge - kContactRadius);
    constexpr double kInGround = 0.1;  // depth of the edge
    const double slope = side * (share > 0 ? std::min(1.15, share * (0.5 + 0.5 * share)) : share);
    return slope + lump_height(x, y) - kInGround;
  }

 private:
  struct Lump {
    double x, y, radius;
  };

  // Returns the height of the highest lump at a position.
  double lump_height(double x, double y) const {
    constexpr double kSteepness = 2;  // of a fillet of a tenth of the diameter, lumps are 0.3 radii high
    double highest = 0;
    for (const Lump& lump : lumps_) {
      const double share = std::hypot(x - lump.x, y - lump.y) / lump.radius;
      if (share < 1) highest = std::max(highest, kSteepness * lump.radius * (1 - share * share));
    }
    return highest;
  }

  std::array<double, 4> phases_;
  std::array<Lump, 90> lumps_;
};

// Returns a fillet: a fan of triangles around the middle, then rings of kAround corners with two triangles between
// neighbouring pairs.
ObjectShape fillet(int number) {
  constexpr std::uint64_t kFilletShapes = 0x66696c6c;  // seed: "fill" in ASCII
  constexpr int kAround = 72, kRings = 16;
  constexpr double kFirstRing = 0.5, kRingSpacing = 0.042;  // radii
  dem::Draws draws(kFilletShapes, 0, number, 0);
  const Mound mound(draws);
  ObjectShape out;
  out.parts = {"soil"};
  const auto add_corner = [&](double x, double y) {
    constexpr double kStep = 0.01;
    const double east = (mound.height(x + kStep, y) - mound.height(x - kStep, y)) / (2 * kStep);
    const double north = (mound.height(x, y + kStep) - mound.height(x, y - kStep)) / (2 * kStep);
    out.corners.push_back(
        {Vec3(x, y, mound.height(x, y)).cast<float>(), Vec3(-east, -north, 1).normalized().cast<float>()});
  };
  add_corner(0, 0);
  for (int ring = 0; ring < kRings; ++ring)
    for (int i = 0; i < kAround; ++i) {
      const double radius = kFirstRing + kRingSpacing * ring, angle = 2 * pi * (i + 0.5 * (ring % 2)) / kAround;
      add_corner(radius * std::cos(angle), radius * std::sin(angle));
    }
  const auto corner = [](int ring, int i) { return static_cast<std::uint32_t>(1 + ring * kAround + i % kAround); };
  for (int i = 0; i < kAround; ++i) {
    out.triangles.push_back({{0, corner(0, i), corner(0, i + 1)}, 0});
    for (int ring = 1; ring < kRings; ++ring) {
      const std::uint32_t a = corner(ring - 1, i);
      const std::uint32_t b = corner(ring, i);
      const std::uint32_t c = corner(ring, i + 1);
      const std::uint32_t d = corner(ring - 1, i + 1);
      // Corners of odd rings are half a side ahead: take the shorter diagonal.
      if (ring % 2 == 1) {
        out.triangles.push_back({{a, b, d}, 0});
        out.triangles.push_back({{b, c, d}, 0});
      } else {
        out.triangles.push_back({{a, b, c}, 0});
        out.triangles.push_back({{a, c, d}, 0});
      }
    }
  }
  return out;
}

// Returns the meshes of the shapes make(0) to make(count - 1). Parallel.
template <typename Make>
std::vector<std::shared_ptr<const ObjectMesh>> make_meshes(std::size_t count, const Make& make) {
  std::vector<std::shared_ptr<const ObjectMesh>> result(count);
  in_parallel(count, [&](std::size_t i) { result[i] = std::make_shared<const ObjectMesh>(make(i)); });
  return result;
}

// Corners of a shape. lying_attitude() rotates a shape so that its largest horizontal extent is along x, from -1/2 to
// 1/2, and z is from 0 to 1. Narrowing along y and stretching along z preserve the largest horizontal extent.
using Points = std::vector<Vec3>;

// Returns the first point with the largest value.
template <typename Value>
const Vec3& largest_by(const Points& points, const Value& value) {
  return *std::max_element(points.begin(), points.end(),
                           [&](const Vec3& a, const Vec3& b) { return value(a) < value(b); });
}

// Returns the points outside the octagon of the farthest points in eight directions, seen from above (Akl & Toussaint
// 1978).
Points outside_octagon(const Points& points) {
  constexpr double kDirections[8][2] = {{1, 0}, {1, 1}, {0, 1}, {-1, 1}, {-1, 0}, {-1, -1}, {0, -1}, {1, -1}};
  std::array<Vec3, 8> corners;  // counter-clockwise
  for (std::size_t k = 0; k < corners.size(); ++k)
    corners[k] =
        largest_by(points, [&](const Vec3& p) { return kDirections[k][0] * p.x() + kDirections[k][1] * p.y(); });
  // Inside are the points to the left of all sides.
  const auto is_inside = [&](const Vec3& p) {
    for (std::size_t k = 0; k < corners.size(); ++k) {
      const Vec3 &a = corners[k], &b = corners[(k + 1) % corners.size()];
      if (a != b && !((b.x() - a.x()) * (p.y() - a.y()) - (b.y() - a.y()) * (p.x() - a.x()) > 0)) return false;
    }
    return true;
  };
  Points outside;
  std::ranges::copy_if(points, std::back_inserter(outside), std::not_fn(is_inside));
  return outside;
}

// Returns the corners of the convex hull seen from above, and points on its sides: the farthest point in any horizontal
// direction is one of them.
Points hull_from_above(const Points& points) {
  Points by_x = outside_octagon(points), hull;
  std::sort(by_x.begin(), by_x.end(),
            [](const Vec3& a, const Vec3& b) { return std::pair(a.x(), a.y()) < std::pair(b.x(), b.y()); });
  // Run the monotone chain of Andrew in both directions.
  for (int side = 0; side < 2; ++side, std::reverse(by_x.begin(), by_x.end())) {
    const std::size_t first = hull.size();
    for (const Vec3& next : by_x) {
      // Returns true if the last corner lies inside the hull: the chain turns right there.
      const auto turns_right = [&] {
        const Vec3 from = hull[hull.size() - 2], a = hull.back() - from, b = next - from;
        return a.x() * b.y() - a.y() * b.x() < 0;
      };
      while (hull.size() >= first + 2 && turns_right()) hull.pop_back();
      hull.push_back(next);
    }
  }
  return hull;
}

// Returns the transformation that rotates and scales a shape as described at Points.
Affine lying_attitude(const Points& shape, const Mat3& rotation) {
  Points rotated;
  for (const Vec3& point : shape) rotated.push_back(rotation * point);
  const Points hull = hull_from_above(rotated);
  // Returns the farthest points forward and backward.
  const auto farthest = [](const Points& points, const Vec3& along) {
    return std::pair(largest_by(points, [&](const Vec3& p) { return p.dot(along); }),
                     largest_by(points, [&](const Vec3& p) { return -p.dot(along); }));
  };
  // Take the largest extent over some directions. From each, follow the line between the farthest corners while the
  // extent grows.
  constexpr int kDirections = 30;
  Vec3 longest = Vec3::zero(), longest_middle = Vec3::zero();
  for (int i = 0; i < kDirections; ++i) {
    Vec3 along(std::cos(pi * i / kDirections), std::sin(pi * i / kDirections), 0);
    for (double previous_length = 0;;) {
      const auto [a, b] = farthest(hull, along);
      const Vec3 chord(a.x() - b.x(), a.y() - b.y(), 0);
      if (chord.norm() > longest.norm()) {
        longest = chord;
        longest_middle = (a + b) / 2;
      }
      if (chord.norm() <= previous_length) break;
      previous_length = chord.norm();
      along = chord / previous_length;
    }
  }
  const auto [top, bottom] = farthest(rotated, Vec3::unit_z());
  const double bottom_z = bottom.z();
  const double top_z = top.z();
  const double width = longest.norm();
  // Turn the longest extent to the x axis and scale it to 1, and put its middle above the origin.
  const Mat3 linear = Mat3::diagonal({1 / width, 1 / width, 1 / (top_z - bottom_z)}) *
                      AngleAxis(-std::atan2(longest.y(), longest.x()), Vec3::unit_z()).matrix() * rotation;
  return {linear, -linear * rotation.transpose_times(Vec3(longest_middle.x(), longest_middle.y(), bottom_z))};
}

constexpr std::size_t kAttitudes = 24;  // attitudes per shape

// Returns each corner once: triangles have corners of their own.
Points distinct_points(const ObjectShape& shape) {
  const auto less = [](const Vec3f& a, const Vec3f& b) {
    return std::lexicographical_compare(a.data(), a.data() + 3, b.data(), b.data() + 3);
  };
  std::set<Vec3f, decltype(less)> distinct(less);
  for (const ObjectCorner& corner : shape.corners) distinct.insert(corner.place);
  Points points;
  for (const Vec3f& point : distinct) points.push_back(point.cast<double>());
  return points;
}

// Returns the attitudes of all shapes, kAttitudes for each. Made once.
const std::vector<Affine>& attitudes() {
  static const auto table = [] {
    constexpr std::uint64_t kSeed = 0x7475726e;  // "turn" in ASCII
    std::vector<Affine> out(rock_shapes().size() * kAttitudes);
    in_parallel(rock_shapes().size(), [&](std::size_t shape) {
      const Points points = distinct_points(rock_shapes()[shape]->shape());
      for (std::size_t i = shape * kAttitudes; i < (shape + 1) * kAttitudes; ++i) {
        dem::Draws draws(kSeed, 0, static_cast<int>(i), 0);
        const Vec3 up = random_direction(draws);
        out[i] = lying_attitude(points, shortest_turn(up, Vec3::unit_z()).matrix());
      }
    });
    return out;
  }();
  return table;
}

// Properties of the appearance of a rock that are drawn from its form.
struct RockAppearance {
  std::size_t rounding;  // below kRoundings
  std::size_t attitude;  // of the stones' kStones * kAttitudes
  std::size_t fillet;    // any number: selects a mound
  double turn;           // about the vertical, radians
  double narrow;         // width across the largest extent, in largest extents
  double reach;          // width of the mound, in diameters
  explicit RockAppearance(const dem::Rock& rock) {
    dem::Draws draws(rock.form, 1, 0, 0);
    const double round = rock.worn + 0.6 * (draws.uniform() - 0.5);
    rounding = static_cast<std::size_t>(std::clamp(round * kRoundings, 0.0, kRoundings - 1.0));
    attitude = draws.bits() % (kStones * kAttitudes);
    fillet = draws.bits();
    turn = 2 * pi * draws.uniform();
    narrow = 0.6 + 0.4 * draws.uniform();
    reach = 1.3 + 0.2 * draws.uniform();
  }
};

// Returns the rotation from ground axes (z up), rotated by `turn` about the vertical, to MOON_ME.
Quat moon_from_ground(const Vec3& up, double turn) {
  return shortest_turn(Vec3::unit_z(), up) * AngleAxis(turn, Vec3::unit_z());
}

}  // namespace

const std::vector<std::shared_ptr<const ObjectMesh>>& rock_shapes() {
  static const auto shapes =
      make_meshes(kStones * kRoundings, [](std::size_t i) { return stone(i / kRoundings, i % kRoundings); });
  return shapes;
}

const std::vector<std::shared_ptr<const ObjectMesh>>& fillet_shapes() {
  constexpr std::size_t kFillets = 4;
  static const auto shapes = make_meshes(kFillets, [](std::size_t i) { return fillet(static_cast<int>(i)); });
  return shapes;
}

PlacedShape placed_rock(const dem::Rock& rock, const Vec3& up) {
  const RockAppearance appearance(rock);
  const std::size_t shape = appearance.attitude / kAttitudes * kRoundings + appearance.rounding;
  const double high_m = rock.height_m / (1 - rock.buried);  // with the part below the ground
  const Affine rock_from_shape{moon_from_ground(up, appearance.turn).matrix() *
                                   Mat3::diagonal({rock.diameter_m, appearance.narrow * rock.diameter_m, high_m}),
                               (rock.height_m - high_m) * up};
  return {rock_shapes()[shape].get(),
          rock_from_shape * attitudes()[shape * kAttitudes + appearance.attitude % kAttitudes]};
}

std::optional<PlacedShape> placed_fillet(const dem::Rock& rock, const Vec3& up) {
  constexpr double kMinFilletHeight = 0.02;  // in diameters; the ground deviates from a plane by as much
  if (!(rock.fillet_m > kMinFilletHeight * rock.diameter_m)) return std::nullopt;
  const RockAppearance appearance(rock);
  const double radius_m = appearance.reach * rock.diameter_m / 2;
  const Mat3 moon_from_shape = moon_from_ground(up, appearance.turn).matrix() *
                               Mat3::diagonal({radius_m, appearance.narrow * radius_m, rock.fillet_m});
  return PlacedShape{fillet_shapes()[appearance.fillet % fillet_shapes().size()].get(), {moon_from_shape}};
}

}  // namespace selenograph::engine
