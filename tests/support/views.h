// Cameras, Suns and requests that many tests share.
#pragma once

#include <cmath>
#include <cstdlib>
#include <numbers>
#include <string_view>
#include <vector>

#include "dem/grid/rotation.h"
#include "engine/frame/request.h"

namespace selenograph::test {

inline constexpr double kDegree = std::numbers::pi / 180;

// Returns the direction toward a Sun that stands at a compass azimuth and an elevation over a place of the sphere.
inline Vec3 local_sun(double lat_deg, double lon_deg, double azimuth_deg, double elevation_deg) {
  return engine::sun_direction(local_axes(lat_deg, lon_deg), azimuth_deg, elevation_deg);
}

// Returns the pose of a camera at `from_m` that looks along `boresight`, with the image's up direction nearest to `up`.
inline engine::Pose looking(const Vec3& from_m, const Vec3& boresight, const Vec3& up) {
  const Vec3 z = boresight.normalized(), x = z.cross(up).normalized();
  const auto camera_from_moon = Mat3::from_rows(x, z.cross(x), z);  // the camera's axes: x right, y down, z boresight
  return {from_m, Quat(camera_from_moon).normalized()};
}

// Returns a square pinhole camera with the principal point in the middle; `fov_deg` is the full angle.
inline engine::Camera square_camera(int size, double fov_deg) {
  const double f = size / 2.0 / std::tan(fov_deg * kDegree / 2);
  return {size, size, f, f, (size - 1) / 2.0, (size - 1) / 2.0, {}};
}

// Returns a request to fill in. The hard cases are tested with both visibility algorithms: by z-buffer, unless the
// environment names ray tracing. ("auto" would ray trace some of these tiny frames in either run.)
inline engine::FrameRequest blank_request() {
  engine::FrameRequest request;
  const char* named = std::getenv("SELENOGRAPH_TEST_VISIBILITY");
  request.visibility =
      named && std::string_view(named) == "raytrace" ? engine::Visibility::raytrace : engine::Visibility::zbuffer;
  return request;
}

// Returns the i-th vector of a product with three components per pixel.
template <typename T>
Vec3 at3(const std::vector<T>& v, std::size_t i) {
  return {static_cast<double>(v[3 * i]), static_cast<double>(v[3 * i + 1]), static_cast<double>(v[3 * i + 2])};
}

}  // namespace selenograph::test
