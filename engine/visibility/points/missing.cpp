#include "engine/visibility/points/missing.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <span>

namespace selenograph::engine {
namespace {

// As far beyond a file's posts there may be ground: it is filled to a pole, and closed where a global file ends.
constexpr double kBeyondFile_deg = 0.25;
constexpr double kCore_m = kMoonRadius_m + double{dem::kLowestRelief_m}, kDatum2 = kMoonRadius_m * kMoonRadius_m;

// Three places of each of some rays.
struct BelowDatum {
  static constexpr int kOfRay = 3;
  Vec3 of_rays[kOfRay * kPacket];
  int rays = 0;
  std::span<const Vec3> all() const { return {of_rays, static_cast<std::size_t>(kOfRay * rays)}; }
  std::span<const Vec3> of(int ray) const { return all().subspan(static_cast<std::size_t>(kOfRay * ray), kOfRay); }
};

std::vector<int> files_at(const dem::Catalogue& catalogue, const Geographic& g) {
  return catalogue.touching(g.lat_deg, g.lat_deg, g.lon_deg, g.lon_deg, kBeyondFile_deg);
}

// Radius of the widest cap around a place that one file covers: mostly so wide that nothing else is looked up.
double covered_rad(const dem::Catalogue& catalogue, const Vec3& place) {
  const Geographic g = to_geographic(place);
  double widest_deg = 0;
  for (const int file : files_at(catalogue, g)) {
    const dem::Footprint& f = catalogue.rasters()[static_cast<std::size_t>(file)].footprint;
    const double south_deg = f.south_deg - kBeyondFile_deg, north_deg = f.north_deg + kBeyondFile_deg,
                 half_deg = (f.east_deg - f.west_deg) / 2 + kBeyondFile_deg,
                 beside_deg = half_deg - std::abs(std::remainder(g.lon_deg - (f.west_deg + f.east_deg) / 2, 360));
    const double to_south_deg = south_deg < -90 ? 180 : g.lat_deg - south_deg,
                 to_north_deg = north_deg > 90 ? 180 : north_deg - g.lat_deg;
    const double sine =
                     std::cos(g.lat_deg * kRadiansPerDegree) * std::sin(std::min(beside_deg, 90.) * kRadiansPerDegree),
                 to_meridian_deg = half_deg >= 180 ? 180 : std::asin(sine) * kDegreesPerRadian;
    widest_deg = std::max(widest_deg, std::min({to_south_deg, to_north_deg, to_meridian_deg}));
  }
  return widest_deg * kRadiansPerDegree;
}

bool in_one_file(const dem::Catalogue& catalogue, std::span<const Vec3> places) {
  Vec3 middle = Vec3::Zero();
  for (const Vec3& place : places) middle += place;
  middle.normalize();
  double nearest = 1;  // cosine of the largest angle from the middle
  for (const Vec3& place : places) nearest = std::min(nearest, middle.dot(place) / place.norm());
  return std::acos(nearest) < covered_rad(catalogue, middle);
}

}  // namespace

MissingData::MissingData(const dem::Catalogue& catalogue, const Vec3& camera_m)
    : catalogue_(catalogue),
      camera_m_(camera_m),
      covered_m_(2 * kCore_m * std::sin(covered_rad(catalogue, camera_m) / 2)) {}

// Whether all rays begin within the datum and leave it where one file covers everything. All at once, as most of an
// image may be such a sky.
bool MissingData::leave_nearby(const Rays& rays, const SurfacePoints& points) const {
  double lowest2 = kDatum2, highest2 = 0, flattest = kDatum2, aside2 = 0;
  for (int i = 0; i < kPacket; ++i) {
    if (!points.toward_moon[i]) continue;
    const Vec3 o = rays.origin(i), d = rays.direction(i);
    const double from2 = o.squaredNorm(), b = o.dot(d);
    lowest2 = std::min(lowest2, from2), highest2 = std::max(highest2, from2);
    flattest = std::min(flattest, b * std::abs(b) / d.squaredNorm());  // squared distance to where it is lowest, signed
    aside2 = std::max(aside2, (o - camera_m_).squaredNorm());
  }
  if (highest2 > kDatum2 || lowest2 + std::min(flattest, 0.0) < kCore_m * kCore_m) return false;
  const double to_lowest_m = std::copysign(std::sqrt(std::abs(flattest)), -flattest);
  return to_lowest_m + std::sqrt(std::abs(flattest) + kDatum2 - lowest2) + std::sqrt(aside2) < covered_m_;
}

std::uint64_t MissingData::count(const Rays& rays, const SurfacePoints& points) const {
  if (std::find(points.toward_moon, points.toward_moon + kPacket, true) == points.toward_moon + kPacket ||
      leave_nearby(rays, points))
    return 0;
  std::uint64_t missing = 0;
  BelowDatum below;
  for (int i = 0; i < kPacket; ++i) {
    if (!points.toward_moon[i]) continue;
    const Vec3 o = rays.origin(i), d = rays.direction(i);
    const double a = d.squaredNorm(), b = o.dot(d), lowest = std::max(0.0, -b / a);
    if ((o + lowest * d).norm() < kCore_m) {
      ++missing;
      continue;
    }
    const double half = std::sqrt(std::max(0.0, b * b - a * (o.squaredNorm() - kDatum2))) / a;
    Vec3* const places = below.of_rays + BelowDatum::kOfRay * below.rays++;
    places[0] = o + std::max(0.0, -b / a - half) * d, places[1] = o + lowest * d, places[2] = o + (half - b / a) * d;
  }
  if (below.rays == 0 || in_one_file(catalogue_, below.all())) return missing;
  const auto without_data = [&](const Vec3& place) { return files_at(catalogue_, to_geographic(place)).empty(); };
  for (int ray = 0; ray < below.rays; ++ray) {
    const std::span<const Vec3> places = below.of(ray);
    missing += std::any_of(places.begin(), places.end(), without_data) ? 1U : 0U;
  }
  return missing;
}

}  // namespace selenograph::engine
