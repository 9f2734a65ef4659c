#include "engine/sky/earth_figure.h"

#include <erfa.h>
#include <erfam.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "engine/frame/sun.h"

namespace selenograph::engine {
namespace {

// Returns false if the Earth cannot eclipse the Sun on the Moon at this epoch. Tests the mean elongation of the Moon
// from the Sun, which differs from the true one by up to 10 degrees; an eclipse is within 3 degrees of full Moon. Costs
// a hundredth of computing both positions.
bool is_near_full_moon(const std::string& utc) {
  const JulianDate tt = tt_at(utc);
  const double elongation = eraFad03(((tt.day - ERFA_DJ00) + tt.fraction) / ERFA_DJC);
  return std::abs(std::remainder(elongation - std::numbers::pi, 2 * std::numbers::pi)) < 15 * kRadiansPerDegree;
}

}  // namespace

EarthFigure::EarthFigure(const SkyObserver& observer)
    : body_(observer.planet(Planet::earth)),
      direction_(observer.moon_me_from_icrf() * body_.direction),
      earth_from_moon_me_(observer.earth_from_icrf(body_.distance_m) * observer.moon_me_from_icrf().transpose()),
      from_centre_(-body_.distance_m / kEquator_m * stretched(earth_from_moon_me_ * direction_)) {}

double EarthFigure::radius_rad() const { return std::asin(kEquator_m / body_.distance_m); }

std::optional<double> EarthFigure::range(const Vec3& direction) const {
  // The ray hits the unit sphere where a t^2 + 2 b t + c = 0. It starts inside for c <= 0, and leads away for b > 0.
  const double a = direction.squared_norm(), b = direction.dot(from_centre_), c = from_centre_.squared_norm() - 1;
  const double discriminant = b * b - a * c;
  if (discriminant <= 0 || b > 0 || c <= 0) return std::nullopt;
  return (-b - std::sqrt(discriminant)) / a;
}

double share_of_sun_covered(const std::string& utc, const Vec3& position_m) {
  if (!is_near_full_moon(utc)) return 0;
  const SkyObserver observer(utc, position_m, Vec3::zero());
  const EarthFigure earth(observer);
  const ApparentBody sun = observer.sun();
  const Vec3 centre = observer.moon_me_from_icrf() * sun.direction;
  const double radius_deg = sun_radius_deg(sun.distance_m / kAstronomicalUnit_m);
  if (centre.dot(earth.direction()) < std::cos(radius_deg * kRadiansPerDegree + earth.radius_rad())) return 0;
  constexpr int kPointsAcross = 100;
  const std::vector<Vec3> points = places_on_sun(centre, radius_deg, kPointsAcross);
  const auto covered = std::count_if(points.begin(), points.end(),
                                     [&](const Vec3& point) { return earth.hides(point, sun.distance_m); });
  return static_cast<double>(covered) / static_cast<double>(points.size());
}

}  // namespace selenograph::engine
