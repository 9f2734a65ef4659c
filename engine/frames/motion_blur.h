// Samples in time of an exposure: how many, when, and what each sees, where the image moves or a row's charge does not
// move as the image does.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "engine/cache/render_context.h"
#include "engine/frame/request.h"
#include "engine/frames/frame_plan.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {

// Longest image motion during an exposure, px, over a grid of places. The ground is taken as a sphere through the
// height `ground_m` (above the datum) below the camera; higher ground moves slightly more. Objects are counted at the
// nearest point of their bounding sphere.
double longest_streak_px(const FrameRequest& request, double integration_time_s, double ground_m,
                         std::span<const Ball> objects);

// The same for the plan's request, with the ground below its camera; of a delayed integration, whose charge follows the
// image, with that in the image's middle.
double longest_streak_px(const FramePlan& plan, double integration_time_s, const Selection& selection,
                         const RenderContext& context);

// Returns the request as it is seen at a time of its exposure, seconds from the middle: by the moved camera, or by the
// detector's line on which the rows' charge is then.
FrameRequest during_exposure(FrameRequest request, double time_s);

// Returns how long a pixel's or a row's charge collects light: through all stages of a delayed integration.
double exposure_s(const FrameRequest& request, double integration_time_s);

// Number of exposure samples: as requested, or the streak's length in pixels, odd, at most Motion::kMaxMoments.
int exposure_sample_count(const SensorModel& sensor, double longest_streak_px);

// Times of the exposure samples, seconds from the exposure's middle.
std::vector<double> exposure_sample_times_s(int count, double integration_time_s);

// Times of the exposure samples of a plan: 0 alone without motion.
std::vector<double> exposure_sample_times_s(const FramePlan& plan, double integration_time_s,
                                            const Selection& selection, const RenderContext& context);

}  // namespace selenograph::engine
