// Where each pixel of a camera looks, solved once for a lens: the place on the plane z = 1 that the lens maps to it, or
// a unit direction where a camera looks past that plane.
#pragma once

#include <cstddef>

#include "dem/support/stop_token.h"
#include "dem/support/uninitialised.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

struct PixelRays {
  PixelRays() = default;
  // Of the places (x + dx, y + dy) of all pixels. Parallel. Throws Cancelled when `stop` says so: a lens near its fold
  // takes a tenth of a millisecond a pixel.
  PixelRays(const Camera& camera, double dx, double dy, const StopToken& stop = {});

  // Of a camera's pixels from those of the same camera with pixels twice as wide and high: by parabolas, which are some
  // 1e-5 of a pixel from what the lens does, and much faster. Parallel.
  PixelRays(const PixelRays& of_pixels, const Camera& camera, const Camera& dense, const StopToken& stop = {});

  // Row-major; NaN where the lens images nothing. Empty for a rectilinear camera. `z`: of unit directions; empty where
  // it is 1 everywhere.
  dem::UninitialisedVector<double> x, y, z;
  std::size_t bytes() const {
    return sizeof(PixelRays) + (x.capacity() + y.capacity() + z.capacity()) * sizeof(double);
  }
};

}  // namespace selenograph::engine
