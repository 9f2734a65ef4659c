#include "engine/scene/anchor.h"

#include <cmath>
#include <optional>

namespace selenograph::engine {
namespace {

// Consecutive frames share an anchor: it is snapped to a lattice.
constexpr double kFinestAnchorLattice_m = 4096, kCoarsestAnchorLattice_m = 32768;

// Distance (in the direction's lengths) at which a ray enters the sphere; 0 from inside, empty when it misses or
// leaves.
std::optional<double> enter_sphere(const Vec3& origin, const Vec3& direction, double radius) {
  const double outside = origin.squaredNorm() - radius * radius;
  if (outside <= 0) return 0.0;
  const double a = direction.squaredNorm(), b = origin.dot(direction);
  const double root2 = b * b - a * outside;
  if (b >= 0 || root2 < 0) return std::nullopt;
  return outside / (-b + std::sqrt(root2));  // the stable form of the nearer root
}

}  // namespace

Vec3 anchor_for(const Vec3& camera_m, const Vec3& middle, double clearance_m) {
  const double distance = camera_m.norm();
  Vec3 near = camera_m * (kMoonRadius_m / distance);
  const double ahead = -camera_m.dot(middle);
  if (distance > 1.2 * kMoonRadius_m && ahead > 0) {
    // Past the limb: the surface that the middle passes closest, which is what a telescope may have in view.
    const auto t = enter_sphere(camera_m, middle, kMoonRadius_m);
    near = t ? Vec3(camera_m + *t * middle) : Vec3((camera_m + ahead * middle).normalized() * kMoonRadius_m);
  }
  double lattice_m = kFinestAnchorLattice_m;
  while (lattice_m < kCoarsestAnchorLattice_m && lattice_m <= 2 * clearance_m) lattice_m *= 2;
  return (near / lattice_m).array().round() * lattice_m;
}

}  // namespace selenograph::engine
