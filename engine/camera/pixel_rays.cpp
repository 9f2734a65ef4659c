#include "engine/camera/pixel_rays.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/parallel.h"
#include "engine/camera/projection.h"

namespace selenograph::engine {

PixelRays::PixelRays(const Camera& camera, double dx, double dy, const StopToken& stop) {
  if (camera.rectilinear()) return;
  const Projection projection(camera);
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  x.resize(width * height);
  y.resize(width * height);
  if (projection.fisheye()) z.resize(width * height);
  in_parallel(height, [&](std::size_t row) {
    for (std::size_t column = 0; column < width; ++column) {
      if (column % 64 == 0) stop.check();
      const Vec3 d = projection.direction(static_cast<double>(column) + dx, static_cast<double>(row) + dy)
                         .value_or(Vec3::constant(std::numeric_limits<double>::quiet_NaN()));
      const std::size_t index = row * width + column;
      x[index] = d.x();
      y[index] = d.y();
      if (!z.empty()) z[index] = d.z();
    }
  });
}

namespace {

// Weights of the parabola through three neighbouring values of n, at a position between or just outside them.
struct Parabola {
  std::size_t first;
  double weight[3];

  Parabola(double position, std::size_t n) {
    const double middle = std::clamp(std::round(position), 1.0, static_cast<double>(n - 2)), t = position - middle;
    first = static_cast<std::size_t>(middle) - 1;
    weight[0] = t * (t - 1) / 2;
    weight[1] = 1 - t * t;
    weight[2] = t * (t + 1) / 2;
  }
};

}  // namespace

// Interpolates the rays of the dense image, two by two samples per pixel a quarter of a pixel off its centre, by a
// parabola in each direction.
PixelRays::PixelRays(const PixelRays& of_pixels, const Camera& camera, const Camera& dense, const StopToken& stop) {
  if (camera.rectilinear()) return;
  if (camera.width < 3 || camera.height < 3) {
    *this = PixelRays(dense, 0, 0, stop);
    return;
  }
  const Projection projection(dense);
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  x.resize(4 * width * height);
  y.resize(x.size());
  if (projection.fisheye()) z.resize(x.size());
  in_parallel(2 * height, [&](std::size_t row) {
    stop.check();
    const Parabola down(static_cast<double>(row) / 2 - 0.25, height);
    for (std::size_t column = 0; column < 2 * width; ++column) {
      const Parabola right(static_cast<double>(column) / 2 - 0.25, width);
      const auto interpolate = [&](const dem::UninitialisedVector<double>& values) {
        double sum = 0;
        for (std::size_t j = 0; j < 3; ++j)
          for (std::size_t i = 0; i < 3; ++i)
            sum += down.weight[j] * right.weight[i] * values[(down.first + j) * width + right.first + i];
        return sum;
      };
      const std::size_t index = row * 2 * width + column, pixel_index = row / 2 * width + column / 2;
      x[index] = interpolate(of_pixels.x);
      y[index] = interpolate(of_pixels.y);
      if (!z.empty()) z[index] = interpolate(of_pixels.z);
      if (!std::isnan(x[index]) || std::isnan(of_pixels.x[pixel_index])) continue;
      // Next to the lens's fold a neighbour is missing: solve the pixel.
      const Vec3 d = projection.direction(static_cast<double>(column), static_cast<double>(row))
                         .value_or(Vec3::constant(std::numeric_limits<double>::quiet_NaN()));
      x[index] = d.x();
      y[index] = d.y();
      if (!z.empty()) z[index] = d.z();
    }
  });
}

}  // namespace selenograph::engine
