#include "engine/lidar/beam.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace selenograph::engine {
namespace {

// Returns the points of a hexagonal lattice within `rings` rings, `spacing` apart.
std::vector<SubRay> hexagonal_lattice(int rings, double spacing) {
  std::vector<SubRay> points;
  for (int i = -rings; i <= rings; ++i)
    for (int j = -rings; j <= rings; ++j)
      if (std::abs(i + j) <= rings) points.push_back({spacing * (i + 0.5 * j), spacing * std::sqrt(0.75) * j, 1});
  return points;
}

// Sets the weights to a Gaussian of deviation s, normalised to sum 1. Returns the variance along one direction.
double weigh(std::vector<SubRay>& points, double s) {
  double sum = 0, variance = 0;
  for (SubRay& p : points) sum += p.weight = std::exp(-(p.x * p.x + p.y * p.y) / (2 * s * s));
  for (SubRay& p : points) {
    p.weight /= sum;
    variance += p.weight * (p.x * p.x + p.y * p.y) / 2;
  }
  return variance;
}

// Sets the weights to the Gaussian that has a given variance, found by bisection of its deviation's logarithm.
void weigh_to_variance(std::vector<SubRay>& points, double variance) {
  double low = 0.05, high = 50;
  for (int k = 0; k < 60; ++k) (weigh(points, std::sqrt(low * high)) < variance ? low : high) = std::sqrt(low * high);
  weigh(points, std::sqrt(low * high));
}

}  // namespace

SubRays::SubRays(int number) {
  if (number == 1) {
    rays = {{0, 0, 1}};
    deviation = 1;
  } else if (number == 7) {
    // The centres have variance 1 - 0.6^2 = 0.64 = 0.8^2: half the weight on the axis, the rest on six points two
    // deviations away.
    deviation = 0.6;
    rays = hexagonal_lattice(1, 2 * 0.8);
    for (SubRay& ray : rays) ray.weight = ray.x == 0 && ray.y == 0 ? 0.5 : 1.0 / 12;
  } else {
    const int rings = number == 19 ? 2 : number == 37 ? 3 : number == 61 ? 4 : 0;
    if (rings == 0) throw std::invalid_argument("a beam has 1, 7, 19, 37 or 61 sub-rays");
    // With a deviation of half the spacing, neighbouring Gaussians add up without dips between them.
    const double spacing = rings == 2 ? 1.1 : rings == 3 ? 0.87 : 0.7;
    deviation = spacing / 2;
    rays = hexagonal_lattice(rings, spacing);
    weigh_to_variance(rays, 1 - deviation * deviation);
  }
  farthest = 0;
  for (const SubRay& ray : rays) farthest = std::max(farthest, std::hypot(ray.x, ray.y));
  farthest += 3 * deviation;
  // Sort by distance from the axis: the scanner takes the first sub-ray as the axis.
  std::stable_sort(rays.begin(), rays.end(), [](const SubRay& a, const SubRay& b) {
    return a.x * a.x + a.y * a.y < b.x * b.x + b.y * b.y - 1e-9;
  });
}

TransverseAxes::TransverseAxes(const Vec3& direction) {
  x = (std::abs(direction.x()) < 0.9 ? Vec3::unit_x() : Vec3::unit_y());
  x = (x - x.dot(direction) * direction).normalized();
  y = direction.cross(x);
}

}  // namespace selenograph::engine
