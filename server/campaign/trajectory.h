// Poses over time from a CSV file, in the form that the Python client's Trajectory.from_csv reads.
#pragma once

#include <string>
#include <vector>

#include "api/json/json_reader.h"

namespace selenograph::server {

struct TimedPose {
  api::Json pose;   // as in a request
  std::string utc;  // empty: the file has seconds
};

// A line of names, and commas; lines that are empty or begin with # are passed over. Columns, in any order:
//   time_s, or utc (ISO 8601); they rise
//   x_m, y_m, z_m, and vx_m_s, vy_m_s, vz_m_s, which single frames don't need; or lat_deg, lon_deg, height_m
//   camera_from_moon_w, .._x, .._y, .._z, or moon_from_camera_w, ...; or up_azimuth_deg: the camera looks at nadir
// `frame`: pose.frame. Throws std::runtime_error naming the file, and the line or the column.
std::vector<TimedPose> read_trajectory(const std::string& path, const std::string& frame);

}  // namespace selenograph::server
