// What optics do to radiance before the detector sees it: point spread and vignetting.
#pragma once

#include <memory>
#include <vector>

#include "dem/support/stop_token.h"
#include "engine/camera/pixel_rays.h"
#include "engine/frame/camera.h"
#include "engine/frame/sensor_model.h"

namespace selenograph::engine {

class AiryTable;

// A normalised kernel of (2 radius + 1)^2 weights, or, where it is a product, of one row and one column of them.
class SpreadKernel {
 public:
  static constexpr int kMaxRadius = 32;
  // lambda N / pitch of an Airy disc, at most: its first dark ring, 1.22 of these away, is within the kernel. A kernel
  // that lost more would not be one of this camera; of wider discs nothing is promised.
  static constexpr double kMaxAiry_px = 26;

  // For a wavelength and a detector's pitch. Integrated over pixels within 1e-5 of the light. Cut off where the rest is
  // below 1e-5 (Gaussian, normalised again), or after 12 rings or at kMaxRadius (Airy, whose wings fall with the
  // distance only): `captured` is the share of the light within. An Airy disc's rest, 1.6 % or so, is spread evenly
  // over the kernel: even light stays as bright, and the weights are the disc's own but for that. Takes milliseconds.
  // Throws Cancelled when `stop` says so, as the functions below do.
  SpreadKernel(const PointSpread& spread, double f_number, double pixel_pitch_um, double wavelength_um,
               const StopToken& stop = {});
  // Of points (dx, dy) beside their pixel's center, half a pixel at most: those of a sub-pixel sample. A measured
  // kernel, which says only what pixels' centers leave, is interpolated linearly, which keeps its centroid.
  SpreadKernel shifted(const PointSpread& spread, double dx, double dy, const StopToken& stop = {}) const;

  int radius() const { return radius_; }
  double captured() const { return captured_; }
  // Of a pixel (dx, dy) away from the point.
  double weight(int dx, int dy) const;

  // `in`: (width + 2 radius) x (height + 2 radius), an image with the border that light comes from; `out`: width x
  // height.
  void apply(const std::vector<float>& in, int width, int height, std::vector<float>& out,
             const StopToken& stop = {}) const;

 private:
  SpreadKernel() = default;
  void spread_airy(double dx, double dy, const StopToken& stop);
  void spread_far_airy(double unit_px);

  int radius_ = 0;
  double captured_ = 1;
  double unit_px_ = 0;  // of an Airy disc: lambda N / (pi pitch)
  std::shared_ptr<const AiryTable> airy_;
  std::vector<float> row_, column_;  // separable: 2 radius + 1 each
  std::vector<float> kernel_;        // else
};

// Multiplies by the transmission at each pixel's angle from the boresight. `rays`: of the pixels' centres, where there
// is distortion. Of a line camera the one row is each row of the radiance.
void vignette(const Vignetting& vignetting, const Camera& camera, const PixelRays& rays, std::vector<float>& radiance,
              const StopToken& stop = {});

}  // namespace selenograph::engine
