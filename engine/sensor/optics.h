// Effects of the optics on radiance: point spread and vignetting.
#pragma once

#include <memory>
#include <vector>

#include "dem/base/stop_token.h"
#include "engine/camera/pixel_rays.h"
#include "engine/frame/camera.h"
#include "engine/frame/sensor_model.h"

namespace selenograph::engine {

class AiryTable;

// A normalised kernel of (2 radius + 1)^2 weights or, if separable, of one row and one column.
class SpreadKernel {
 public:
  // Largest radius; a measured kernel with light on its border has one more (use_measured()).
  static constexpr int kMaxRadius = 32;
  // Largest lambda N / pitch of an Airy disc: its first dark ring, at 1.22 times this, is within the kernel. Wider
  // discs are not supported: the kernel would lose too much of their light.
  static constexpr double kMaxAiry_px = 26;

  // Makes a kernel for a wavelength and a pixel pitch, integrated over pixels to within 1e-5 of the light. A Gaussian
  // is cut off where the rest is below 1e-5, and renormalised. An Airy disc, whose wings decrease slowly, is cut off
  // after 12 rings or at kMaxRadius; `captured` is the share of its light within. The rest, about 1.6 %, is spread over
  // the kernel, so that uniform light keeps its level: evenly, plus a slope that keeps the centroid. Takes
  // milliseconds. Throws Cancelled when stopped, as the functions below do.
  SpreadKernel(const PointSpread& spread, double f_number, double pixel_pitch_um, double wavelength_um,
               const StopToken& stop = {});
  // Returns the kernel for points at an offset (dx, dy), at most half a pixel, from their pixel's center, as sub-pixel
  // samples are. A measured kernel has values at pixel centers only and is interpolated linearly, which keeps its sum
  // and moves its centroid by the offset.
  SpreadKernel shifted(const PointSpread& spread, double dx, double dy, const StopToken& stop = {}) const;

  int radius() const { return radius_; }
  double captured() const { return captured_; }
  // Returns the weight of the pixel at (dx, dy) from the point's pixel.
  double weight(int dx, int dy) const;

  // Convolves an image. `in`: (width + 2 radius) x (height + 2 radius), with the border from which light spreads into
  // the image; `out`: width x height.
  void apply(const std::vector<float>& in, int width, int height, std::vector<float>& out,
             const StopToken& stop = {}) const;

 private:
  SpreadKernel() = default;
  void spread_airy(double dx, double dy, const StopToken& stop);
  void spread_far_airy(double unit_px);
  void use_measured(const PointSpread& spread);

  int radius_ = 0;
  double captured_ = 1;
  double unit_px_ = 0;  // Airy disc: lambda N / (pi pitch)
  std::shared_ptr<const AiryTable> airy_;
  std::vector<float> row_, column_;  // separable: 2 radius + 1 each
  std::vector<float> kernel_;        // otherwise
};

// Returns the transmission in a direction (camera axes, unit length). For cos^4 it is 0 behind the aperture's plane.
double transmission(const Vignetting& vignetting, const Vec3& in_camera);

// Multiplies each pixel by the transmission at its angle from the boresight. `rays`: directions of the pixel centres,
// for a camera with distortion. The single row of a line camera applies to each row of the radiance.
void vignette(const Vignetting& vignetting, const Camera& camera, const PixelRays& rays, std::vector<float>& radiance,
              const StopToken& stop = {});

}  // namespace selenograph::engine
