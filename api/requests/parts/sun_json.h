// "sun": a direction toward the Sun, given in one of five ways.
#pragma once

#include <optional>
#include <string>

#include "api/requests/parts/pose_json.h"
#include "api/schema/members.h"
#include "engine/frame/sun.h"

namespace selenograph::api {

// Direction to the Sun by azimuth and elevation at a place.
struct SunLocal {
  double lat_deg = 0, lon_deg = 0, azimuth_deg = 0, elevation_deg = 0;
};
// "sun" as a client writes it: exactly one of direction, subsolar, local and an epoch gives the direction.
struct SunForm : EpochForm {
  std::optional<Vec3> direction;
  std::optional<Geographic> subsolar;
  std::optional<SunLocal> local;
  std::optional<double> distance_au;
  std::optional<std::optional<double>> angular_radius_deg;  // the inner optional is empty for the word "sun"
  std::optional<double> limb_darkening;
};
const Members<SunForm, engine::Sun>& sun_members();

// Returns the epoch of an object with "utc" or "et_s", as UTC; empty if it has neither or the epoch is invalid.
std::string utc_of(const Json& object);
// Returns the epoch of a request's "sun", as UTC, for ReadContext.
std::string utc_of_sun(const Json& body);

}  // namespace selenograph::api
