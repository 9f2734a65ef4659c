// Limits of one request.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>

namespace selenograph::api {

struct Limits {
  std::size_t max_body_bytes = std::size_t{4} << 20;
  int max_image_side = 8192;
  std::int64_t max_image_pixels = std::int64_t{16} << 20;
  std::int64_t max_map_pixels = std::int64_t{16} << 20;
  int max_samples_per_pixel = 256;
  int max_rays = 100000;                                // rays or points of a request; craters of a response
  std::int64_t max_lidar_rays = std::int64_t{1} << 24;  // sub-rays of all beams of a lidar's scan
  std::chrono::milliseconds default_deadline{60000};    // clients may ask for less: header `Request-Timeout-Ms`
};

}  // namespace selenograph::api
