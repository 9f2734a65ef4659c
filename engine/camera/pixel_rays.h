// Where each pixel of a camera looks, solved once for a lens: the place on the plane z = 1 that the lens maps to it.
#pragma once

#include <cstddef>
#include <vector>

#include "engine/frame/camera.h"

namespace selenograph::engine {

struct PixelRays {
  PixelRays() = default;
  // Of the places (x + dx, y + dy) of all pixels. Parallel.
  PixelRays(const Camera& camera, double dx, double dy);

  // Row-major; NaN where the lens has folded: nothing is seen there. Empty for a camera without distortion.
  std::vector<double> x, y;
  std::size_t bytes() const { return sizeof(PixelRays) + (x.capacity() + y.capacity()) * sizeof(double); }
};

}  // namespace selenograph::engine
