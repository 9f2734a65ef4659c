// The Earth as a body that hides what is behind it, as seen from a place near the Moon.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <optional>
#include <string>

#include "engine/sky/sky_observer.h"

namespace selenograph::engine {

// An ellipsoid (WGS 84) at the Earth's apparent place, turned as SkyObserver::earth_from_icrf says. Its axes are the
// Earth's, stretched along the z axis so that the ellipsoid is a sphere of radius 1.
class EarthFigure {
 public:
  explicit EarthFigure(const SkyObserver& observer);

  static constexpr double kEquator_m = 6378137, kStretch = 1 / (1 - 1 / 298.257223563);
  static Vec3 stretched(const Vec3& v) { return {v.x(), v.y(), v.z() * kStretch}; }

  const ApparentBody& body() const { return body_; }
  const Vec3& direction() const { return direction_; }  // of its centre, unit, MOON_ME
  double radius_rad() const;                            // of the equator
  // The Earth's axes, not stretched.
  const Eigen::Matrix3d& earth_from_moon_me() const { return earth_from_moon_me_; }
  // From the centre to the observer, in radii.
  const Vec3& from_centre() const { return from_centre_; }

  // Of two stretched directions: a bilinear and symmetric form whose square is 0 where a ray touches the limb.
  double off_limb(const Vec3& a, const Vec3& b) const {
    return a.dot(from_centre_) * b.dot(from_centre_) - (from_centre_.squaredNorm() - 1) * a.dot(b);
  }
  // Range, in radii and in multiples of the direction, at which a stretched direction meets it; empty beside it, and
  // from within.
  std::optional<double> range(const Vec3& direction) const;

  // Whether it is before something in a unit direction, MOON_ME, at a distance.
  bool hides(const Vec3& direction, double distance_m = std::numeric_limits<double>::infinity()) const {
    return distance_m > body_.distance_m && range(stretched(earth_from_moon_me_ * direction));
  }

 private:
  ApparentBody body_;
  Vec3 direction_;
  Eigen::Matrix3d earth_from_moon_me_;
  Vec3 from_centre_;
};

// Share of the Sun's disc, by area and to 0.002, that the Earth covers at a UTC epoch for an observer within 10 000 km
// of the Moon's centre, at a position from there along axes of MOON_ME: what an eclipse of the Sun takes. Throws as
// sun_at.
double share_of_sun_covered(const std::string& utc, const Vec3& position_m);

}  // namespace selenograph::engine
