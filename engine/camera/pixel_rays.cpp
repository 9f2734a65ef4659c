#include "engine/camera/pixel_rays.h"

#include <limits>

#include "dem/parallel.h"
#include "engine/camera/projection.h"

namespace selenograph::engine {

PixelRays::PixelRays(const Camera& camera, double dx, double dy, const StopToken& stop) {
  if (camera.rectilinear()) return;
  const Projection projection(camera);
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  x.resize(width * height), y.resize(width * height);
  if (projection.fisheye()) z.resize(width * height);
  in_parallel(height, [&](std::size_t row) {
    for (std::size_t column = 0; column < width; ++column) {
      if (column % 64 == 0) stop.check();
      const Vec3 d = projection.direction(static_cast<double>(column) + dx, static_cast<double>(row) + dy)
                         .value_or(Vec3::Constant(std::numeric_limits<double>::quiet_NaN()));
      const std::size_t at = row * width + column;
      x[at] = d.x(), y[at] = d.y();
      if (!z.empty()) z[at] = d.z();
    }
  });
}

}  // namespace selenograph::engine
