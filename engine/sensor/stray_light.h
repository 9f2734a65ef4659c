// Light that the optics scatter: wide wings of the point spread over the whole frame, and glare of a Sun outside it.
#pragma once

#include <cstddef>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/geodesy.h"
#include "engine/frame/camera.h"
#include "engine/frame/sensor_model.h"

namespace selenograph::engine {

// Every point has the wings of a point on the boresight of a pinhole. Harvey and Shack's law depends only on
// differences of direction cosines, so in the image it is the same everywhere, except that pixels measure the tangent
// of the field angle instead of the sine.
class ScatteredLight {
 public:
  // Returns the scattered share of the light: the law's integral over the hemisphere (total integrated scatter).
  static double share(const StrayLight& law);

  // Prepares the kernel for frames of the camera's size, in the time of one apply(). It depends only on the law (not on
  // sun_within_deg) and the camera's size and focal lengths.
  ScatteredLight(const StrayLight& law, const Camera& camera, const StopToken& stop = {});

  // Scatters light from pixel to pixel, by Fourier transforms in double: exact to rounding. Light that leaves the image
  // is lost, and none enters. `image`: of the camera's size.
  void apply(std::vector<float>& image, const StopToken& stop = {}) const;
  // Returns the share of a pixel's light that arrives in the pixel at (dx, dy) from it.
  double weight(int dx, int dy) const;
  std::size_t bytes() const { return sizeof(*this) + transfer_.capacity() * sizeof(double); }

 private:
  double weight_of_centre() const;

  StrayLight law_;
  double share_;
  int width_, height_;
  double fx_, fy_;
  int columns_, rows_;            // size of the transforms: image plus kernel, so that nothing wraps around
  std::vector<double> transfer_;  // transform of the kernel, column by column; real, because the kernel is symmetric
};

// Adds the Sun's light scattered into each pixel: the law times the irradiance on the aperture. `toward_sun`: camera
// axes, unit; `irradiance_w_m2`: at normal incidence. Returns the largest glare of a pixel, W m-2 sr-1.
double add_glare(const StrayLight& law, const Camera& camera, const Vec3& toward_sun, double irradiance_w_m2,
                 std::vector<float>& image, const StopToken& stop = {});

}  // namespace selenograph::engine
