#include "engine/scene/anchor.h"

#include <algorithm>
#include <cmath>

#include "dem/grid/lattice.h"

namespace selenograph::engine {
namespace {

// Spacing of the lattice that anchors snap to, so that consecutive frames share one.
constexpr double kFinestAnchorLattice_m = 4096, kCoarsestAnchorLattice_m = 32768;
// Spacing of the lattice in posts, for posts closer than a metre.
constexpr double kPostsPerLattice = kFinestAnchorLattice_m;

// Returns the distance, in lengths of the direction, at which a ray enters the sphere; 0 from inside, empty if it
// misses or leaves.
std::optional<double> enter_sphere(const Vec3& origin, const Vec3& direction, double radius) {
  const double outside = origin.squared_norm() - radius * radius;
  if (outside <= 0) return 0.0;
  const double a = direction.squared_norm(), b = origin.dot(direction);
  const double root2 = b * b - a * outside;
  if (b >= 0 || root2 < 0) return std::nullopt;
  return outside / (-b + std::sqrt(root2));  // the stable form of the nearer root
}

Vec3 rounded(const Vec3& v) { return {std::round(v.x()), std::round(v.y()), std::round(v.z())}; }

}  // namespace

std::optional<FineGround> fine_ground(std::span<const dem::BlockId> blocks, const dem::Terrain& terrain) {
  const auto finest =
      std::max_element(blocks.begin(), blocks.end(), [](const auto& a, const auto& b) { return a.level < b.level; });
  if (finest == blocks.end() || dem::post_spacing_m(finest->level) >= 1) return std::nullopt;
  const dem::NodeInfo node = terrain.node(*finest);
  if (node.empty) return std::nullopt;
  return FineGround{dem::post_spacing_m(finest->level),
                    (static_cast<double>(node.min_m) + static_cast<double>(node.max_m)) / 2};
}

Vec3 anchor_for(const Vec3& camera_m, const Vec3& middle, double clearance_m, const std::optional<FineGround>& fine) {
  const double distance = camera_m.norm();
  // The vertical is undefined for a ray that begins at the Moon's centre.
  const Vec3 up = distance > 1 ? Vec3(camera_m / distance) : middle;
  if (fine) {
    const double ground_m = kMoonRadius_m + fine->height_m,
                 min_lattice_m = std::max(kPostsPerLattice * fine->finest_m, distance - ground_m),
                 lattice_m = std::exp2(std::floor(std::log2(min_lattice_m)));
    if (lattice_m < kFinestAnchorLattice_m) return rounded(up * (ground_m / lattice_m)) * lattice_m;
  }
  Vec3 near = up * kMoonRadius_m;
  const double ahead = -camera_m.dot(middle);
  if (distance > 1.2 * kMoonRadius_m && ahead > 0) {
    // Beyond the limb, take the surface that the middle ray passes closest: a telescope may have it in view.
    const auto t = enter_sphere(camera_m, middle, kMoonRadius_m);
    near = t ? Vec3(camera_m + *t * middle) : Vec3((camera_m + ahead * middle).normalized() * kMoonRadius_m);
  }
  double lattice_m = kFinestAnchorLattice_m;
  while (lattice_m < kCoarsestAnchorLattice_m && lattice_m <= 2 * clearance_m) lattice_m *= 2;
  return rounded(near / lattice_m) * lattice_m;
}

}  // namespace selenograph::engine
