// Expose stage: from radiance to the image, by a sensor model or by gain and quantisation alone.
#pragma once

#include <optional>

#include "engine/cache/render_context.h"
#include "engine/camera/pixel_rays.h"
#include "engine/frame/frame.h"
#include "engine/frames/frame_plan.h"
#include "engine/frames/frame_selection.h"
#include "engine/visibility/image/frame_job.h"

namespace selenograph::engine {

// The middle of an exposure, to which all ground truth belongs.
struct ExposureMiddle {
  const FrameSelection& selected;
  const PixelRays& pixel_rays;  // of the middle: by its angles all samples are vignetted
};

// Returns a callback that adds the samples of the middle's pixels to the sensor; empty if the sensor takes none of
// them.
EachSample samples_for_sensor(const FramePlan& plan, const ExposureMiddle& middle, std::optional<Sensor>& sensor,
                              const StopToken& stop);

// A frame with its image and without the sensor's margin, what exposing adds to its report, and the time it took.
struct ExposedFrame {
  FrameProducts products;
  FrameReport report;
  StageTimes times;
};

// Draws what the sensor counts in addition to the middle's radiance (photons in a band of their own, other exposure
// samples, the sky), and makes the image. `drawn`: products of the middle. Radiance that was not requested is removed.
// Throws as Renderer::render does.
ExposedFrame expose_frame(const FramePlan& plan, const ExposureMiddle& middle, FrameProducts drawn,
                          std::optional<Sensor>& sensor, const RenderContext& context);

}  // namespace selenograph::engine
