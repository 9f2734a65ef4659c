// Cameras, Suns and terrain of the hard cases.
#pragma once

#include <cmath>

#include "tests/support/views.h"

namespace selenograph::test {

// Returns the unit vector with a compass azimuth (clockwise from north) and an elevation at a place, for a Sun or a
// boresight.
inline Vec3 local_direction(const Vec3& place_m, double azimuth_deg, double elevation_deg) {
  return engine::sun_direction(local_axes(place_m), azimuth_deg, elevation_deg);
}

// Returns a request for a frame of the finest posts, with the products that the judge compares.
inline engine::FrameRequest square_view(const engine::Pose& pose, int side, double fov_deg, const Vec3& sun) {
  engine::FrameRequest request = blank_request();
  request.camera = square_camera(side, fov_deg);
  request.pose = pose;
  request.sun.direction = sun;
  request.accuracy.max_error_px = 0;
  request.products = engine::kRadiance | engine::kDepth | engine::kPosition | engine::kNormal | engine::kLit;
  return request;
}

// Returns the same for a camera that looks straight down, north up.
inline engine::FrameRequest nadir_view(const Geographic& from, int side, double fov_deg, const Vec3& sun) {
  const Vec3 place = to_cartesian(from);
  return square_view(looking(place, -place, local_axes(place).north), side, fov_deg, sun);
}

// Returns the height of crags of all sizes that posts of 118 m resolve: a few hundred metres high, slopes up to about
// 35 degrees.
inline double crags(double lat_deg, double lon_deg) {
  return 250 * std::sin(31 * lat_deg) * std::cos(27 * lon_deg) + 120 * std::sin(83 * lat_deg + 61 * lon_deg) +
         30 * std::sin(331 * lat_deg) * std::sin(307 * lon_deg);
}

}  // namespace selenograph::test
