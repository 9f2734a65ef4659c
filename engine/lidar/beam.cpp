#include "engine/lidar/beam.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

namespace selenograph::engine {
namespace {

// The lattice's points within `rings` rings, `spacing` apart.
std::vector<SubRay> hexagon(int rings, double spacing) {
  std::vector<SubRay> points;
  for (int i = -rings; i <= rings; ++i)
    for (int j = -rings; j <= rings; ++j)
      if (std::abs(i + j) <= rings) points.push_back({spacing * (i + 0.5 * j), spacing * std::sqrt(0.75) * j, 1});
  return points;
}

// Weights of a Gaussian of deviation s, which sum to 1. Returns the variance along a direction.
double weigh(std::vector<SubRay>& points, double s) {
  double sum = 0, variance = 0;
  for (SubRay& p : points) sum += p.weight = std::exp(-(p.x * p.x + p.y * p.y) / (2 * s * s));
  for (SubRay& p : points) p.weight /= sum, variance += p.weight * (p.x * p.x + p.y * p.y) / 2;
  return variance;
}

// With the weights that give a variance.
void weigh_to(std::vector<SubRay>& points, double variance) {
  double low = 0.05, high = 50;
  for (int k = 0; k < 60; ++k) (weigh(points, std::sqrt(low * high)) < variance ? low : high) = std::sqrt(low * high);
  weigh(points, std::sqrt(low * high));
}

}  // namespace

SubRays::SubRays(int number) {
  if (number == 1) {
    rays = {{0, 0, 1}}, part = 1;
  } else if (number == 7) {
    // Variance 0.64: half in the middle, the rest on six points 2 of its deviations away.
    part = 0.6, rays = hexagon(1, 2 * 0.8);
    for (SubRay& ray : rays) ray.weight = ray.x == 0 && ray.y == 0 ? 0.5 : 1.0 / 12;
  } else {
    const int rings = number == 19 ? 2 : number == 37 ? 3 : number == 61 ? 4 : 0;
    if (rings == 0) throw std::invalid_argument("a beam has 1, 7, 19, 37 or 61 sub-rays");
    // Half as wide as they are apart, neighbours sum up without dips.
    const double spacing = rings == 2 ? 1.1 : rings == 3 ? 0.87 : 0.7;
    part = spacing / 2, rays = hexagon(rings, spacing);
    weigh_to(rays, 1 - part * part);
  }
  farthest = 0;
  for (const SubRay& ray : rays) farthest = std::max(farthest, std::hypot(ray.x, ray.y));
  farthest += 3 * part;
  // The axis first.
  std::stable_sort(rays.begin(), rays.end(), [](const SubRay& a, const SubRay& b) {
    return a.x * a.x + a.y * a.y < b.x * b.x + b.y * b.y - 1e-9;
  });
}

Across::Across(const Vec3& direction) {
  x = (std::abs(direction.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY());
  x = (x - x.dot(direction) * direction).normalized();
  y = direction.cross(x);
}

}  // namespace selenograph::engine
