// Converts the radiance of a frame's moments to its image, by a sensor model or by gain and quantisation alone.
#pragma once

#include <vector>

#include "dem/base/stop_token.h"
#include "engine/frame/frame.h"
#include "engine/frames/frame_moment.h"
#include "engine/frames/frame_plan.h"
#include "engine/sky/sky_image.h"

namespace selenograph::engine {

class FrameExposure {
 public:
  // `middle`: the middle of the exposure, with its scene made. All arguments must outlive this object.
  FrameExposure(FramePlan& plan, const FrameMoment& middle, const dem::Terrain& terrain, RenderCache& kept,
                const StopToken& stop)
      : plan_(plan), middle_(middle), terrain_(terrain), kept_(kept), stop_(stop) {}

  // Callback for the samples of the middle, when the middle is the whole exposure; empty if samples are not needed.
  EachSample each_of_middle() const;

  // Draws what the sensor counts in addition to the middle's radiance, which `frame` already has: photons in its own
  // band, and the exposure's other moments.
  void draw_moments(Frame& frame);
  // Makes the image. Removes what was drawn only for it: the margin, and radiance that was not requested.
  void make_image(Frame& frame);

 private:
  EachSample each(float share) const;
  // `share`: of the exposure, for samples that the sensor takes one by one; 0: it takes none of them.
  FrameProducts draw(const FrameRequest& request, float share, Frame& frame, bool other_moment);
  void show_discs(const FrameRequest& request, const std::vector<double>& range_m, float share,
                  std::vector<float>& radiance);
  float share_of_middle() const { return plan_.moving() || plan_.counted ? 0.F : 1.F; }
  SkyImage sky_of(const FrameRequest& request, const std::vector<double>& range_m) const;
  void add_points(const SkyImage& sky, double share);
  void add_glare();
  std::vector<float> mean_of_moments(int moments, const std::vector<float>& in_the_middle, Frame& frame);
  void capture(Frame& frame);

  FramePlan& plan_;
  const FrameMoment& middle_;
  const dem::Terrain& terrain_;
  RenderCache& kept_;
  const StopToken& stop_;
  std::vector<float> captured_;   // radiance in the sensor's band
  double brightest_w_m2_sr_ = 0;  // in the middle of the exposure, without discs and sky
  // Of the brightest pixel, whose spectrum stands for all: what is counted over the radiance in the request's band.
  double counted_over_radiance_ = 1;
};

}  // namespace selenograph::engine
