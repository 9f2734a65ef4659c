// Cameras, Suns and terrain of the hard cases.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <string>
#include <vector>

#include "engine/frame.h"

namespace selenograph::test {

inline constexpr double kRadiansPerDegree = std::numbers::pi / 180;

// A compass azimuth (clockwise from north) and an elevation at a place, as a unit vector.
inline Vec3 local_direction(const Vec3& place, double azimuth_deg, double elevation_deg) {
  const EastNorthUp axes = local_axes(place);
  const double azimuth = azimuth_deg * kRadiansPerDegree, elevation = elevation_deg * kRadiansPerDegree;
  return (std::cos(elevation) * (std::sin(azimuth) * axes.east + std::cos(azimuth) * axes.north) +
          std::sin(elevation) * axes.up)
      .normalized();
}

// Looking along a boresight with the image's up as near as can be to `up`.
inline engine::Pose looking(const Vec3& from, const Vec3& boresight, const Vec3& up) {
  const Vec3 z = boresight.normalized(), x = z.cross(up).normalized();
  Eigen::Matrix3d camera_from_moon;
  camera_from_moon << x.transpose(), z.cross(x).transpose(), z.transpose();
  return {from, Eigen::Quaterniond(camera_from_moon).normalized()};
}

// Of the finest posts, with all that a judge wants to know.
inline engine::FrameRequest square_view(const engine::Pose& pose, int side, double fov_deg, const Vec3& sun) {
  engine::FrameRequest request;
  const double focal = side / 2.0 / std::tan(fov_deg / 2 * kRadiansPerDegree), centre = (side - 1) / 2.0;
  request.camera = {side, side, focal, focal, centre, centre, {}};
  request.pose = pose;
  request.sun.direction = sun;
  request.accuracy.max_error_px = 0;
  request.products = engine::kRadiance | engine::kDepth | engine::kPosition | engine::kNormal | engine::kLit;
  return request;
}

inline engine::FrameRequest nadir_view(const Geographic& from, int side, double fov_deg, const Vec3& sun) {
  const Vec3 place = to_cartesian(from);
  return square_view(looking(place, -place, local_axes(place).north), side, fov_deg, sun);
}

template <typename T>
Vec3 component(const std::vector<T>& products, std::size_t pixel) {
  return Eigen::Matrix<T, 3, 1>(products[3 * pixel], products[3 * pixel + 1], products[3 * pixel + 2])
      .template cast<double>();
}

// Crags of all sizes that posts of 118 m resolve, a few hundred metres high, slopes up to about 35 degrees.
inline double crags(double lat_deg, double lon_deg) {
  return 250 * std::sin(31 * lat_deg) * std::cos(27 * lon_deg) + 120 * std::sin(83 * lat_deg + 61 * lon_deg) +
         30 * std::sin(331 * lat_deg) * std::sin(307 * lon_deg);
}

}  // namespace selenograph::test
