#include "engine/camera/pixel_rays.h"

#include <limits>

#include "dem/parallel.h"
#include "engine/camera/lens.h"

namespace selenograph::engine {

PixelRays::PixelRays(const Camera& camera, double dx, double dy) {
  if (camera.distortion.none()) return;
  const Lens lens(camera.distortion);
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  x.resize(width * height), y.resize(width * height);
  in_parallel(height, [&](std::size_t row) {
    for (std::size_t column = 0; column < width; ++column) {
      const auto p = lens.undistorted((static_cast<double>(column) + dx - camera.cx) / camera.fx,
                                      (static_cast<double>(row) + dy - camera.cy) / camera.fy);
      constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
      const std::size_t at = row * width + column;
      x[at] = p ? p->x() : kNone, y[at] = p ? p->y() : kNone;
    }
  });
}

}  // namespace selenograph::engine
