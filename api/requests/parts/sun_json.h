// "sun": a direction toward the Sun, given in one of five ways.
#pragma once

#include <optional>
#include <string>

#include "api/requests/parts/pose_json.h"
#include "api/schema/members.h"
#include "engine/frame/sun.h"

namespace selenograph::api {

struct SunLocal {
  double lat_deg = 0, lon_deg = 0, azimuth_deg = 0, elevation_deg = 0;
};
struct SunForm : EpochForm {
  std::optional<Vec3> direction;
  std::optional<Geographic> subsolar;
  std::optional<SunLocal> local;
  std::optional<double> distance_au;
  std::optional<std::optional<double>> angular_radius_deg;  // the inner one is empty for "sun"
  std::optional<double> limb_darkening;
};
const Members<SunForm, engine::Sun>& sun_members();

// The epoch that an object gives as "utc" or "et_s", as UTC; empty: it gives none that can be read.
std::string utc_of(const Json& object);
// The epoch of a request's "sun", for ReadContext.
std::string utc_of_sun(const Json& body);

}  // namespace selenograph::api
