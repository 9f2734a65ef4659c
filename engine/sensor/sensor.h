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

// DN = clamp(round(L / full scale * (2^bits - 1))). Returns the full scale that was used: as given, otherwise the
// largest radiance in the frame (0 when everything is dark).
double expose(const ImageSettings& settings, const std::vector<float>& radiance, std::vector<std::uint16_t>& image);

// Whether any pixel's radiance is above 0. NaN is not.
bool any_lit(std::span<const float> radiance);

// Index of the largest radiance, the first of several, of at least one pixel. By all threads.
std::size_t brightest_pixel(std::span<const float> radiance);

// Whether the spectrum that a sensor counts by a factor is the Moon's, which the ground has, and not the Sun's.
bool counts_moonlight(const FrameRequest& request);

// Share of pixels whose radiance exceeds `limit`.
double share_above(const std::vector<float>& radiance, double limit);

// A point of light in an image without margin: its irradiance over the solid angle of a pixel, in the band in which the
// detector counts photons (in_photons).
struct LightPoint {
  double x_px, y_px;
  Vec3 in_camera;  // unit
  double counted_w_m2_sr;
  std::optional<int> row = {};  // that it is in view of, alone; empty: of all
};

// Adds `value` to an image, spread over a square of one pixel around a place: each of the four pixels that it covers
// gets its share. The centroid is the place, the variance t (1 - t) square pixels along each axis, where t is the
// distance to a pixel's centre. `only_row`: in that row alone.
void add_square(std::vector<float>& image, int width, int height, double x_px, double y_px, double value,
                std::optional<int> only_row = {});

// The sensor model of a frame. Light spreads into the image from around it, so the frame is rendered with a margin: the
// border is as exact as the middle.
class Sensor {
 public:
  // `request` must have a sensor and a band. Throws Cancelled when `stop` says so, as image() does.
  explicit Sensor(const FrameRequest& request, const StopToken& stop = {});

  // Eq. (8) for a wide band: photons are counted over the band. For sunlight alone, or the Moon's light alone, this is
  // a constant factor. When other light has its own spectrum, radiance must be rendered in the returned band, in which
  // the detector counts photons.
  std::optional<Band> photon_band(bool one_spectrum);

  // Chooses the integration time, if the request leaves it to the frame, from the radiance at the middle of the
  // exposure, as image() takes it. `camera`: RowViews::camera().
  void choose_integration_time(const Camera& camera, const PixelRays& rays, std::vector<float> radiance,
                               const StopToken& stop = {});
  double integration_time_s() const { return model_.detector.integration_time_s; }
  // Electrons that light frees in the brightest pixel of the last image: after the optics, without smear, dark current
  // and noise.
  double brightest_signal_e() const { return read_out_.brightest_e; }
  // Of sunlight, the radiance as it is counted over that in the request's band: 1 without a photon_band().
  double counted_of_sunlight() const { return sunlight_um_ / wavelength_um_; }
  // Share of saturated pixels of the last image.
  double saturated_fraction() const { return read_out_.saturated_fraction; }
  // Smear alone as a share of a pixel's capacity: maximum over all but the brightest thousandth of the columns.
  double smear_fill() const { return read_out_.smear_e / saturation_e(model_.detector); }

  const Camera& camera() const { return request_.camera; }  // of the image: without margin
  int margin_px() const { return kernel_.radius(); }
  double captured() const { return kernel_.captured(); }
  // Radiance of the largest digital number, as it is counted, W m-2 sr-1.
  double full_scale_counted_w_m2_sr() const;

  // A point spread applies to points: when pixels are means over samples, each sample is spread by itself, and the sum
  // of the added samples becomes the image, whatever radiance image() is given. `share`: of the exposure.
  bool wants_samples() const;
  void add_sample(const Camera& camera, const PixelRays& rays, const SubpixelSample& sample, float share,
                  std::vector<float> radiance, const StopToken& stop);

  // Adds points of light to the image: each leaves the point spread of its own place. Between eighths of a pixel that
  // is interpolated linearly, which preserves its centroid. Without a point spread the light is that of a pixel-sized
  // square (add_square). `share`: of the exposure.
  void add_points(std::span<const LightPoint> points, double share, const StopToken& stop);
  void forget_points() { points_.clear(); }
  // Required before choose_integration_time() and image() of a model with stray light: its, for camera().
  void scatter_by(std::shared_ptr<const ScatteredLight> scattered) { scattered_ = std::move(scattered); }
  // Adds what a Sun beside the field scatters into the image (add_glare). `counted_w_m2`: its irradiance as the
  // detector counts photons (in_photons).
  void add_glare(const Vec3& toward_sun, double counted_w_m2, const StopToken& stop);
  double glare_w_m2_sr() const { return largest_glare_w_m2_sr_; }
  // Electrons that a point frees in all pixels, without noise.
  double point_e(const LightPoint& point) const;

  // `radiance`, `camera` and `rays` include the margin.
  void image(const Camera& camera, const PixelRays& rays, std::vector<float> radiance,
             std::vector<std::uint16_t>& image, const StopToken& stop = {});

 private:
  const SpreadKernel& shifted(double dx, double dy, const StopToken& stop);
  void add_kernel(const SpreadKernel& kernel, int column, int row, double value, std::optional<int> only_row);
  void pass_optics(const Camera& camera, const PixelRays& rays, std::vector<float>& radiance,
                   const StopToken& stop) const;
  // Adds the points, scatters all of it and adds the glare.
  void complete(std::vector<float>& radiance, const StopToken& stop);

  const FrameRequest& request_;
  SensorModel model_;                   // with its integration time
  double sunlight_um_, wavelength_um_;  // at which eq. (8) counts sunlight, and what is drawn
  SpreadKernel kernel_;
  std::map<std::pair<double, double>, SpreadKernel> shifted_;  // by sample offset
  std::vector<float> samples_;                                 // sum of the spread samples; empty: none was added
  std::vector<float> points_;                                  // light of the points; empty: none was added
  std::shared_ptr<const ScatteredLight> scattered_;            // null: none
  std::vector<float> glare_;                                   // empty: none
  double largest_glare_w_m2_sr_ = 0;
  ReadOut read_out_;
};

// The camera with `margin_px` more pixels on each side.
Camera with_margin(Camera camera, int margin_px);
// Removes the margin from the products; those of a TruthGrid have none. `camera`: with the margin.
void crop(FrameProducts& products, const Camera& camera, int margin_px, bool of_truth_grid);

}  // namespace selenograph::engine
