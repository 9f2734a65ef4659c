// The Earth as an occluder, as seen from a place near the Moon.
#pragma once

#include <limits>
#include <optional>
#include <string>

#include "engine/sky/sky_observer.h"

namespace selenograph::engine {

// An ellipsoid (WGS 84) at the Earth's apparent place, rotated by SkyObserver::earth_from_icrf. Intersections are
// computed in stretched axes: the Earth's, stretched along the z axis so that the ellipsoid is a sphere of radius 1.
class EarthFigure {
 public:
  explicit EarthFigure(const SkyObserver& observer);

  static constexpr double kEquator_m = 6378137;                    // equatorial radius, WGS 84
  static constexpr double kStretch = 1 / (1 - 1 / 298.257223563);  // equatorial over polar radius
  // Returns a vector of the Earth's axes in axes in which the ellipsoid is a sphere.
  static Vec3 stretched(const Vec3& v) { return {v.x(), v.y(), v.z() * kStretch}; }

  const ApparentBody& body() const { return body_; }
  const Vec3& direction() const { return direction_; }  // of the Earth's centre, unit, MOON_ME
  double radius_rad() const;                            // angular radius of the equator
  // Rotates vectors of MOON_ME into the Earth's axes, not stretched.
  const Mat3& earth_from_moon_me() const { return earth_from_moon_me_; }
  // From the Earth's centre to the observer, stretched axes, in Earth radii.
  const Vec3& from_centre() const { return from_centre_; }

  // Evaluates the limb's cone for two stretched directions: a bilinear, symmetric form. limb_form(d, d) is 0 if a ray
  // along d touches the limb, and positive if the line hits the Earth.
  double limb_form(const Vec3& a, const Vec3& b) const {
    return a.dot(from_centre_) * b.dot(from_centre_) - (from_centre_.squared_norm() - 1) * a.dot(b);
  }
  // Returns the range, in multiples of the stretched direction, at which a ray hits the Earth. Empty if it misses, or
  // starts inside.
  std::optional<double> range(const Vec3& direction) const;

  // Returns whether the Earth occludes a target in a unit direction, MOON_ME, at a distance.
  bool hides(const Vec3& direction, double distance_m = std::numeric_limits<double>::infinity()) const {
    return distance_m > body_.distance_m && range(stretched(earth_from_moon_me_ * direction));
  }

 private:
  ApparentBody body_;
  Vec3 direction_;
  Mat3 earth_from_moon_me_;
  Vec3 from_centre_;
};

// Returns the share of the Sun's disc, by area and to 0.002, that the Earth covers in an eclipse. `position_m`: of the
// observer, MOON_ME, within 10 000 km of the Moon's centre. Throws as sun_at.
double share_of_sun_covered(const std::string& utc, const Vec3& position_m);

}  // namespace selenograph::engine
