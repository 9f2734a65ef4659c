// Converts radiance to digital numbers, by a sensor model or by exposure and quantisation alone.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "engine/frame/request.h"
#include "engine/sensor/detector.h"
#include "engine/sensor/optics.h"
#include "engine/sensor/stray_light.h"
#include "engine/visibility/image/frame_job.h"

namespace selenograph::engine {

// Sets DN = clamp(round(L / full scale * (2^bits - 1))). Returns the full scale that was used: as requested, otherwise
// that of almost_brightest() (0 when everything is dark).
double expose(const ImageSettings& settings, const std::vector<float>& radiance, std::vector<std::uint16_t>& image);

// Returns whether any pixel's radiance is above 0. NaN is not.
bool any_lit(std::span<const float> radiance);

// Returns the radiance that all but the brightest thousandth of the lit pixels have at most; 0 if none is lit. NaN is
// not. Parallel.
double almost_brightest(std::span<const float> radiance);

// Returns the index of the largest radiance, the first of equal ones. `radiance` must not be empty. Parallel.
std::size_t brightest_pixel(std::span<const float> radiance);

// Returns whether a sensor counts photons of the Moon's spectrum, which this reflectance model has, instead of the
// Sun's.
bool counts_moonlight(const FrameRequest& request);

// Returns the share of pixels whose radiance exceeds `limit`.
double share_above(const std::vector<float>& radiance, double limit);

// A point of light in an image without margin: its irradiance over the solid angle of a pixel, in the band in which the
// detector counts photons (in_photons).
struct LightPoint {
  double x_px, y_px;
  Vec3 in_camera;  // unit
  double counted_w_m2_sr;
  std::optional<int> row = {};  // the only row that images it; empty: all rows
};

// Adds `value` to an image, spread over a square of one pixel around (x_px, y_px):
//
//   +-----+-----+   Each of the four pixels that the square covers gets the covered share. The centroid is the point;
//   |  +--|--+  |   the variance is t (1 - t) square pixels along each axis, where t is the distance to a pixel's
//   +--|--x--|--+   centre.
//   |  +--|--+  |
//   +-----+-----+
//
// `only_row`: adds to that row only.
void add_square(std::vector<float>& image, int width, int height, double x_px, double y_px, double value,
                std::optional<int> only_row = {});

// The sensor model of a frame. Light spreads into the image from around it, so the frame is rendered with a margin: the
// border is as exact as the middle.
class Sensor {
 public:
  // `request` must have a sensor and a band. Throws Cancelled when `stop` says so, as image() does.
  explicit Sensor(const FrameRequest& request, const StopToken& stop = {});

  // Applies eq. (8) to a wide band: photons are counted over the band. For one spectrum, the Sun's or the Moon's, this
  // is a constant factor. With several spectra, render radiance in the returned band, in which the detector counts
  // photons.
  std::optional<Band> photon_band(bool one_spectrum);

  // Chooses the integration time, if the request leaves it to the frame, from the radiance at the middle of the
  // exposure, as image() takes it. `camera`: RowViews::camera().
  void choose_integration_time(const Camera& camera, const PixelRays& rays, std::vector<float> radiance,
                               const StopToken& stop = {});
  double integration_time_s() const { return model_.detector.integration_time_s; }
  // Electrons that light frees in the brightest pixel of the last image: after the optics, without smear, dark current
  // and noise.
  double brightest_signal_e() const { return read_out_.brightest_e; }
  // Returns the counted radiance of sunlight over its radiance in the request's band: 1 without a photon_band().
  double counted_of_sunlight() const { return sunlight_um_ / wavelength_um_; }
  // Share of saturated pixels of the last image.
  double saturated_fraction() const { return read_out_.saturated_fraction; }
  // Smear alone as a share of a pixel's capacity: maximum over all but the brightest thousandth of the columns.
  double smear_fill() const { return read_out_.smear_e / saturation_e(model_.detector); }

  const Camera& camera() const { return request_.camera; }  // camera of the image, without margin
  int margin_px() const { return kernel_.radius(); }
  double captured() const { return kernel_.captured(); }
  // Returns the counted radiance of the largest digital number, W m-2 sr-1.
  double full_scale_counted_w_m2_sr() const;

  // Returns whether samples must be added one by one: a point spread applies to points, so with several samples per
  // pixel each sample is spread by itself. The sum of the added samples then replaces the radiance given to image().
  // `share`: the sample's share of the exposure.
  bool wants_samples() const;
  void add_sample(const Camera& camera, const PixelRays& rays, const SubpixelSample& sample, float share,
                  std::vector<float> radiance, const StopToken& stop);

  // Adds points of light to the image, each with the point spread for its sub-pixel position. Between eighths of a
  // pixel the spread is interpolated linearly, which preserves its centroid. Without a point spread a point becomes a
  // pixel-sized square (add_square). `share`: share of the exposure.
  void add_points(std::span<const LightPoint> points, double share, const StopToken& stop);
  void forget_points() { points_.clear(); }
  // Sets the model's stray light for camera(). Required before choose_integration_time() and image() if the model has
  // stray light.
  void scatter_by(std::shared_ptr<const ScatteredLight> scattered) { scattered_ = std::move(scattered); }
  // Adds the light that a Sun outside the field scatters into the image (engine::add_glare). `counted_w_m2`: its
  // irradiance as the detector counts photons (in_photons).
  void add_glare(const Vec3& toward_sun, double counted_w_m2, const StopToken& stop);
  double glare_w_m2_sr() const { return largest_glare_w_m2_sr_; }
  // Returns the electrons that a point frees in all pixels, without noise.
  double point_e(const LightPoint& point) const;

  // Makes the image. `radiance`, `camera` and `rays` include the margin.
  void image(const Camera& camera, const PixelRays& rays, std::vector<float> radiance,
             std::vector<std::uint16_t>& image, const StopToken& stop = {});

 private:
  const SpreadKernel& shifted(double dx, double dy, const StopToken& stop);
  void add_kernel(const SpreadKernel& kernel, int column, int row, double value, std::optional<int> only_row);
  void pass_optics(const Camera& camera, const PixelRays& rays, std::vector<float>& radiance,
                   const StopToken& stop) const;
  // Adds the points, scatters the sum and adds the glare.
  void complete(std::vector<float>& radiance, const StopToken& stop);

  const FrameRequest& request_;
  SensorModel model_;                   // with the chosen integration time
  double sunlight_um_, wavelength_um_;  // wavelengths at which eq. (8) counts sunlight, and the rendered radiance
  SpreadKernel kernel_;
  std::map<std::pair<double, double>, SpreadKernel> shifted_;  // by sample offset
  std::vector<float> samples_;                                 // sum of the spread samples; empty: none was added
  std::vector<float> points_;                                  // light of the points; empty: none was added
  std::shared_ptr<const ScatteredLight> scattered_;            // null: none
  std::vector<float> glare_;                                   // empty: none
  double largest_glare_w_m2_sr_ = 0;
  ReadOut read_out_;
};

// Returns the camera with `margin_px` more pixels on each side.
Camera with_margin(Camera camera, int margin_px);
// Removes the margin from the products. Those of a TruthGrid have none, except for radiance. `camera`: with the margin.
void crop(FrameProducts& products, const Camera& camera, int margin_px, bool of_truth_grid);

}  // namespace selenograph::engine
