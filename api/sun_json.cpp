// "sun": a direction toward the Sun, given in one of four ways.
#include <cmath>
#include <numbers>

#include "api/frame_json.h"
#include "api/ranges.h"
#include "dem/error.h"

namespace selenograph::api {
namespace {

Vec3 read_direction(const JsonReader& in) {
  const std::optional<Vec3> direction = direction_of(in.vector(kAnyNumber));
  if (!direction && in.good()) in.fail("is zero: no direction");
  return direction.value_or(Vec3::UnitX());
}

Vec3 read_local(const JsonReader& in) {
  if (!in.object({"lat_deg", "lon_deg", "azimuth_deg", "elevation_deg"})) return Vec3::UnitX();
  const Geographic place{in.number("lat_deg", kLatitude_deg), in.number("lon_deg", kLongitude_deg), 0};
  const double azimuth_deg = in.number("azimuth_deg", kAzimuth_deg);
  const double elevation_deg = in.number("elevation_deg", kElevation_deg);
  return engine::sun_direction(to_cartesian(place), azimuth_deg, elevation_deg);
}

engine::SunPosition read_utc(const JsonReader& in) {
  const std::optional<std::string> utc = in.text();
  if (!utc) return {};
  try {
    return engine::sun_at(*utc);
  } catch (const ImpossibleRequest& e) {
    in.fail(e.what());
    return {};
  }
}

}  // namespace

engine::Sun read_sun(const JsonReader& in) {
  engine::Sun sun;
  if (!in.object({"direction", "subsolar", "local", "utc", "distance_au", "angular_radius_deg", "limb_darkening"}))
    return sun;
  const std::string_view how = in.alternative({"direction", "subsolar", "local", "utc"}, true);
  if (how == "direction") sun.direction = read_direction(in.at(how));
  if (how == "subsolar") sun.direction = to_cartesian(read_place(in.at(how), false)).normalized();
  if (how == "local") sun.direction = read_local(in.at(how));
  if (how == "utc") {
    const engine::SunPosition position = read_utc(in.at(how));
    sun.direction = position.direction;
    sun.distance_au = position.distance_au;
  }
  sun.distance_au = in.number("distance_au", kDistance_au, sun.distance_au);
  sun.angular_radius_deg = in.number("angular_radius_deg", kAngularRadius_deg, 0);
  sun.limb_darkening = in.number("limb_darkening", kUnitInterval, 0);
  return sun;
}

}  // namespace selenograph::api
