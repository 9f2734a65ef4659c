// Directions of all pixels of a camera with distortion, solved once: undistorted positions on the plane z = 1, or unit
// directions for cameras that image directions beyond that plane.
#pragma once

#include <cstddef>

#include "dem/base/stop_token.h"
#include "dem/base/uninitialised.h"
#include "engine/frame/camera.h"

namespace selenograph::engine {

struct PixelRays {
  PixelRays() = default;
  // Solves the directions at (x + dx, y + dy) of all pixels, in parallel. Throws Cancelled once `stop` is requested:
  // near the end of its valid range a lens takes a tenth of a millisecond per pixel.
  PixelRays(const Camera& camera, double dx, double dy, const StopToken& stop = {});

  // Interpolates the directions of a camera with pixels half as wide and high (`dense`) by parabolas from those of
  // `camera`, in parallel. The error is about 1e-5 pixels, and this is much faster than solving.
  PixelRays(const PixelRays& of_pixels, const Camera& camera, const Camera& dense, const StopToken& stop = {});

  // Row by row; NaN where the lens images nothing; empty for a rectilinear camera. `z` is empty if it is 1 everywhere.
  dem::UninitialisedVector<double> x, y, z;
  std::size_t bytes() const {
    return sizeof(PixelRays) + (x.capacity() + y.capacity() + z.capacity()) * sizeof(double);
  }
};

}  // namespace selenograph::engine
