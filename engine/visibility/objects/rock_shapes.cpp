#include "engine/visibility/objects/rock_shapes.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <utility>

#include "dem/detail/size_cells.h"
#include "engine/visibility/objects/object_mesh.h"

namespace selenograph::engine {
namespace {

using std::numbers::pi;

constexpr int kShapes = 16;

struct Sphere {
  std::vector<Vec3> corners;
  std::vector<ObjectTriangle> triangles;
};

// An icosahedron, each of whose triangles is cut into four, and so on.
Sphere sphere(int cuts) {
  const double phi = std::numbers::phi;
  Sphere s{{{-1, phi, 0},
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
  for (const auto& face : kFaces) s.triangles.push_back({face, 0});
  for (int i = 0; i < cuts; ++i) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [at, is_new] = middles.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(s.corners.size()));
      if (is_new) s.corners.push_back(s.corners[a] + s.corners[b]);
      return at->second;
    };
    std::vector<ObjectTriangle> finer;
    for (const ObjectTriangle& t : s.triangles) {
      const auto [a, b, c] = t.corner;
      const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
      for (const auto& face : {std::array{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}})
        finer.push_back({face, 0});
    }
    s.triangles = std::move(finer);
    for (Vec3& corner : s.corners) corner.normalize();
  }
  return s;
}

Vec3 any_direction(dem::Draws& draws) {
  const double z = 2 * draws.uniform() - 1, turn = 2 * pi * draws.uniform(), around = std::sqrt(1 - z * z);
  return {around * std::cos(turn), around * std::sin(turn), z};
}

ObjectShape shape(int number) {
  constexpr std::uint64_t kRockShapes = 0x726f636b;
  dem::Draws draws(kRockShapes, 0, number, 0);
  Sphere s = sphere(3);
  constexpr int kPlanes = 16;
  std::array<std::pair<Vec3, double>, kPlanes> planes;
  for (auto& [normal, distance] : planes) normal = any_direction(draws), distance = 0.62 + 0.33 * draws.uniform();
  for (Vec3& corner : s.corners) {
    double reach = 1;
    for (const auto& [normal, distance] : planes)
      if (const double along = normal.dot(corner); along > 0) reach = std::min(reach, distance / along);
    corner *= reach;
  }
  const double narrow = 0.65 + 0.35 * draws.uniform();
  double wide = 0, high = 0, low = 0;
  for (Vec3& corner : s.corners) {
    corner.y() *= narrow;
    high = std::max(high, corner.z()), low = std::min(low, corner.z());
  }
  for (const Vec3& a : s.corners)
    for (const Vec3& b : s.corners) wide = std::max(wide, (a - b).head<2>().norm());
  const double above = 0.5 + 0.2 * draws.uniform(), under = above / 3;
  ObjectShape out;
  out.parts = {"rock"};
  for (const Vec3& c : s.corners) {
    const double z = (c.z() - low) / (high - low) * (above + under) - under;
    out.corners.push_back({Eigen::Vector3d(c.x() / wide, c.y() / wide, z).cast<float>(), Eigen::Vector3f::Zero()});
  }
  out.triangles = std::move(s.triangles);
  return out;
}

}  // namespace

const std::vector<std::shared_ptr<const ObjectMesh>>& rock_shapes() {
  static const auto shapes = [] {
    std::vector<std::shared_ptr<const ObjectMesh>> all;
    for (int i = 0; i < kShapes; ++i) all.push_back(std::make_shared<const ObjectMesh>(shape(i)));
    return all;
  }();
  return shapes;
}

RockPose rock_pose(std::uint64_t form, const Vec3& up) {
  constexpr std::uint64_t kTurns = std::uint64_t{1} << 32;
  const double turn = 2 * pi * static_cast<double>(form % kTurns) / static_cast<double>(kTurns);
  return {form / kTurns % kShapes,
          Eigen::Quaterniond::FromTwoVectors(Vec3::UnitZ(), up) * Eigen::AngleAxisd(turn, Vec3::UnitZ())};
}

}  // namespace selenograph::engine
