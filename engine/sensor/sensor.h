// Radiance to digital numbers: by a sensor's model, or by exposure and quantisation alone where there is none.
#pragma once

#include <cstdint>
#include <vector>

#include "engine/frame/request.h"
#include "engine/sensor/optics.h"

namespace selenograph::engine {

// DN = clamp(round(L / full scale * (2^bits - 1))). Answers the full scale that was used: as given, else the largest
// radiance in the frame (0 when everything is dark).
double expose(const ImageSettings& settings, const std::vector<float>& radiance, std::vector<std::uint16_t>& image);

// A frame's sensor, with what follows from it. Light spreads into the image from around it: the frame is rendered with
// a margin, so that the border is as exact as the middle.
class Sensor {
 public:
  // Of a request that has a sensor and a band. Throws Cancelled when `stop` says so, as image() does.
  explicit Sensor(const FrameRequest& request, const StopToken& stop = {});

  int margin_px() const { return kernel_.radius(); }
  double captured() const { return kernel_.captured(); }
  // Of the largest digital number, W m-2 sr-1.
  double full_scale_radiance_w_m2_sr() const;

  // `radiance` has the margin around it, as `view` and `rays` have.
  void image(const View& view, const PixelRays& rays, std::vector<float> radiance, std::vector<std::uint16_t>& image,
             const StopToken& stop = {}) const;

 private:
  const FrameRequest& request_;
  SpreadKernel kernel_;
};

// The pose so many seconds later.
Pose moved(const Pose& pose, const Motion& motion, double seconds);

// The camera with so many pixels more on each side.
Camera with_margin(Camera camera, int margin_px);
// Takes them away again from all products. `camera`: with the margin.
void crop(FrameProducts& products, const Camera& camera, int margin_px);

}  // namespace selenograph::engine
