#include "api/answers/turned_sky.h"

#include <fmt/format.h>

#include <algorithm>

#include "dem/grid/rotation.h"
#include "engine/frame/needs.h"
#include "engine/sky/ephemeris.h"

namespace selenograph::api {

double sky_turned_deg(const engine::FrameRequest& request, double icrf_lag_s) {
  constexpr double kMinShift_px = 0.05;
  if (icrf_lag_s == 0 || !request.sky || !request.sky->any() || !engine::wants_radiance(request)) return 0;
  const std::string& utc = request.sky->utc;
  // The Moon's rotation from the sky's epoch to that of the poses.
  const Mat3 rotation = engine::moon_me_from_icrf(utc, icrf_lag_s) * engine::moon_me_from_icrf(utc).transpose();
  const double angle_rad = AngleAxis(rotation).angle_rad;
  const double shift_px = angle_rad * std::max(request.camera.fx, request.camera.fy);
  return shift_px < kMinShift_px ? 0 : angle_rad / kRadiansPerDegree;
}

void warn_of_turned_sky(const engine::FrameRequest& request, double icrf_lag_s, nlohmann::ordered_json& warnings) {
  if (const double turned_deg = sky_turned_deg(request, icrf_lag_s); turned_deg > 0)
    warnings.push_back(fmt::format(
        "the epoch of a pose in ICRF is {:.6g} s from that of the sky, and the Moon turns by {:.2g} degrees "
        "meanwhile: what is beyond the Moon is seen as far from where this attitude points. Give both one "
        "epoch; with times of rows the sky is that of its epoch for all of them",
        icrf_lag_s, turned_deg));
}

}  // namespace selenograph::api
