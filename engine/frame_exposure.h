// From the radiance of a frame's moments to its image: by a sensor's model, or by gain and quantisation alone.
#pragma once

#include <vector>

#include "dem/support/stop_token.h"
#include "engine/frame/frame.h"
#include "engine/frame_moment.h"
#include "engine/frame_plan.h"

namespace selenograph::engine {

class FrameExposure {
 public:
  // `middle`: of the exposure, whose scene is made. All outlive this.
  FrameExposure(FramePlan& plan, const FrameMoment& middle, const dem::Terrain& terrain, RenderCache& kept,
                const StopToken& stop)
      : plan_(plan), middle_(middle), terrain_(terrain), kept_(kept), stop_(stop) {}

  // What takes the samples of the middle where that is all of the exposure; empty where nothing does.
  EachSample each_of_middle() const;

  // Draws what the sensor counts besides the middle's radiance, which `frame` has: its photons, the exposure's other
  // moments.
  void draw_moments(Frame& frame);
  // The image. Takes away what was drawn for it alone: the margin, and radiance that was not asked for.
  void make_image(Frame& frame);

 private:
  EachSample each(float share) const;
  std::vector<float> draw(const FrameRequest& request, const EachSample& each, Frame& frame, bool other_moment);
  std::vector<float> mean_of_moments(int moments, const std::vector<float>& in_the_middle, Frame& frame);
  void capture(Frame& frame);

  FramePlan& plan_;
  const FrameMoment& middle_;
  const dem::Terrain& terrain_;
  RenderCache& kept_;
  const StopToken& stop_;
  std::vector<float> captured_;  // radiance, as the sensor counts it
};

}  // namespace selenograph::engine
