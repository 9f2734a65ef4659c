// Directions of all pixels of a camera with distortion, solved once: the undistorted place on the plane z = 1, or a
// unit direction for cameras that see beyond that plane.
#pragma once

#include <cstddef>

#include "dem/base/stop_token.h"
#include "dem/base/uninitialised.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

struct PixelRays {
  PixelRays() = default;
  // Directions of the places (x + dx, y + dy) of all pixels. Parallel. Throws Cancelled when `stop` says so: near the
  // end of its valid range a lens takes a tenth of a millisecond per pixel.
  PixelRays(const Camera& camera, double dx, double dy, const StopToken& stop = {});

  // Directions of a camera's pixels, interpolated by parabolas from those of the same camera with pixels twice as wide
  // and high. The error is about 1e-5 pixels, and it is much faster than solving. Parallel.
  PixelRays(const PixelRays& of_pixels, const Camera& camera, const Camera& dense, const StopToken& stop = {});

  // Row-major; NaN where the lens images nothing. Empty for a rectilinear camera. `z`: of unit directions; empty when
  // it is 1 everywhere.
  dem::UninitialisedVector<double> x, y, z;
  std::size_t bytes() const {
    return sizeof(PixelRays) + (x.capacity() + y.capacity() + z.capacity()) * sizeof(double);
  }
};

}  // namespace selenograph::engine
