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
  // A measured kernel with light on its border has one more (take_measured()).
  static constexpr int kMaxRadius = 32;
  // Largest lambda N / pitch of an Airy disc: its first dark ring, at 1.22 times this, is within the kernel. Wider
  // discs are not supported: the kernel would lose too much of their light.
  static constexpr double kMaxAiry_px = 26;

  // Makes a kernel for a wavelength and a pixel pitch, integrated over pixels to within 1e-5 of the light. It is cut
  // off where the rest is below 1e-5 (Gaussian, renormalised), or after 12 rings or at kMaxRadius (Airy, whose wings
  // decrease slowly): `captured` is the share of the light within. The rest of an Airy disc, about 1.6 %, is spread
  // over the kernel, evenly but for a slope that keeps the light's mean place: uniform light keeps its level. Takes
  // milliseconds. Throws Cancelled when `stop` says so, as the functions below do.
  SpreadKernel(const PointSpread& spread, double f_number, double pixel_pitch_um, double wavelength_um,
               const StopToken& stop = {});
  // Returns the kernel for points at an offset (dx, dy), at most half a pixel, from their pixel's center: those of a
  // sub-pixel sample. A measured kernel, which is known at pixel centers only, is interpolated linearly. That keeps its
  // sum, and moves its centroid by the offset.
  SpreadKernel shifted(const PointSpread& spread, double dx, double dy, const StopToken& stop = {}) const;

  int radius() const { return radius_; }
  double captured() const { return captured_; }
  // Weight of the pixel at (dx, dy) from the point.
  double weight(int dx, int dy) const;

  // `in`: (width + 2 radius) x (height + 2 radius), an image with the border from which light spreads into it; `out`:
  // width x height.
  void apply(const std::vector<float>& in, int width, int height, std::vector<float>& out,
             const StopToken& stop = {}) const;

 private:
  SpreadKernel() = default;
  void spread_airy(double dx, double dy, const StopToken& stop);
  void spread_far_airy(double unit_px);
  void take_measured(const PointSpread& spread);

  int radius_ = 0;
  double captured_ = 1;
  double unit_px_ = 0;  // Airy disc: lambda N / (pi pitch)
  std::shared_ptr<const AiryTable> airy_;
  std::vector<float> row_, column_;  // separable: 2 radius + 1 each
  std::vector<float> kernel_;        // otherwise
};

// Transmission in the direction of a point (camera axes, unit length). From behind the aperture's plane cos^4 leaves
// nothing.
double transmission(const Vignetting& vignetting, const Vec3& in_camera);

// Multiplies by the transmission at each pixel's angle from the boresight. `rays`: of the pixel centres, for a camera
// with distortion. For a line camera, its one row applies to each row of the radiance.
void vignette(const Vignetting& vignetting, const Camera& camera, const PixelRays& rays, std::vector<float>& radiance,
              const StopToken& stop = {});

}  // namespace selenograph::engine
