// Light that the optics scatter: wide wings of the point spread, over the whole frame, and glare of a Sun beside it.
#pragma once

#include <cstddef>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/grid/geodesy.h"
#include "engine/frame/camera.h"
#include "engine/frame/sensor_model.h"

namespace selenograph::engine {

// The wings are those of a point on the boresight of a pinhole, wherever the point is: in direction cosines Harvey and
// Shack's law is the same everywhere, and so it is in the image, but for the tangent over the sine of the field angle.
class ScatteredLight {
 public:
  // Share of the light that is scattered: the law's integral over the hemisphere (total integrated scatter).
  static double share(const StrayLight& law);

  // Frames of the camera's size. Takes as long as apply(); depends on nothing but the law, but for sun_within_deg, and
  // the camera's size and focal lengths.
  ScatteredLight(const StrayLight& law, const Camera& camera, const StopToken& stop = {});

  // Scatters light from pixel to pixel, by Fourier transforms in double: exact to rounding. What leaves the image is
  // lost, and none comes from beyond it. `image`: of the camera's size.
  void apply(std::vector<float>& image, const StopToken& stop = {}) const;
  // Share of a pixel's light that arrives in the pixel at (dx, dy) from it.
  double weight(int dx, int dy) const;
  std::size_t bytes() const { return sizeof(*this) + transfer_.capacity() * sizeof(double); }

 private:
  double weight_of_middle() const;

  StrayLight law_;
  double share_;
  int width_, height_;
  double fx_, fy_;
  int columns_, rows_;            // of the transforms, which have room for a whole kernel
  std::vector<double> transfer_;  // of the kernel: real, since it is symmetric; a column after the other
};

// Adds the Sun's light that is scattered into each pixel: the law times the irradiance on the aperture. `toward_sun`:
// camera axes, unit; `irradiance_w_m2`: at normal incidence. Returns the largest, W m-2 sr-1.
double add_glare(const StrayLight& law, const Camera& camera, const Vec3& toward_sun, double irradiance_w_m2,
                 std::vector<float>& image, const StopToken& stop = {});

}  // namespace selenograph::engine
