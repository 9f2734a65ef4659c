// Radiance to digital numbers: by a sensor's model, or by exposure and quantisation alone where there is none.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "engine/frame/request.h"
#include "engine/sensor/detector.h"
#include "engine/sensor/optics.h"
#include "engine/visibility/image/frame_job.h"

namespace selenograph::engine {

// DN = clamp(round(L / full scale * (2^bits - 1))). Answers the full scale that was used: as given, else the largest
// radiance in the frame (0 when everything is dark).
double expose(const ImageSettings& settings, const std::vector<float>& radiance, std::vector<std::uint16_t>& image);

// Share of the pixels whose radiance is more than that.
double share_above(const std::vector<float>& radiance, double limit);

// A frame's sensor, with what follows from it. Light spreads into the image from around it: the frame is rendered with
// a margin, so that the border is as exact as the middle.
class Sensor {
 public:
  // Of a request that has a sensor and a band. Throws Cancelled when `stop` says so, as image() does.
  explicit Sensor(const FrameRequest& request, const StopToken& stop = {});

  // Eq. (8) of a wide band: photons are counted over it. Of sunlight alone that is a factor. Where other light has a
  // spectrum of its own, radiance is to be rendered in the band that this returns, as the detector counts it.
  std::optional<Band> photon_band(bool sunlight_alone);

  // From the frame in the middle of the exposure, as image() takes it; where the request leaves that to the frame.
  // `camera`: RowViews::camera().
  void choose_integration_time(const Camera& camera, const PixelRays& rays, std::vector<float> radiance,
                               const StopToken& stop = {});
  double integration_time_s() const { return model_.detector.integration_time_s; }
  // Of the pixels of the last image.
  double saturated_fraction() const { return read_out_.saturated_fraction; }
  // Smear alone, as a share of what a pixel holds, in all but the brightest thousandth of its columns, at most.
  double smear_fill() const { return read_out_.smear_e / saturation_e(model_.detector); }

  int margin_px() const { return kernel_.radius(); }
  double captured() const { return kernel_.captured(); }
  // Of the largest digital number, W m-2 sr-1.
  double full_scale_radiance_w_m2_sr() const;

  // A point spread is of points: where pixels are means over samples, each sample is spread by itself, and what was
  // added is the image, whatever radiance image() is given. `share` of the exposure.
  bool wants_samples() const;
  void add_sample(const Camera& camera, const PixelRays& rays, const SubpixelSample& sample, float share,
                  std::vector<float> radiance, const StopToken& stop);

  // `radiance` has the margin around it, as `camera` and `rays` have.
  void image(const Camera& camera, const PixelRays& rays, std::vector<float> radiance,
             std::vector<std::uint16_t>& image, const StopToken& stop = {});

 private:
  void pass_optics(const Camera& camera, const PixelRays& rays, std::vector<float>& radiance,
                   const StopToken& stop) const;

  const FrameRequest& request_;
  SensorModel model_;  // with its integration time
  double wavelength_um_;
  SpreadKernel kernel_;
  std::map<std::pair<double, double>, SpreadKernel> shifted_;  // by their samples' offsets
  std::vector<float> samples_;                                 // their sum so far; empty: none was added
  ReadOut read_out_;
};

// The camera with so many pixels more on each side.
Camera with_margin(Camera camera, int margin_px);
// Takes them away again from the products: those of a TruthGrid have none. `camera`: with the margin.
void crop(FrameProducts& products, const Camera& camera, int margin_px, bool of_truth_grid);

}  // namespace selenograph::engine
