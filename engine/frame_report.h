// What is said of a frame besides its pixels, once it is drawn.
#pragma once

#include "engine/frame/frame.h"
#include "engine/frame_moment.h"
#include "engine/frame_plan.h"

namespace selenograph::engine {

// `moment` is the one that the products show.
void report_frame(const FramePlan& plan, const FrameMoment& moment, const Drawn& drawn, const dem::Terrain& terrain,
                  Frame& frame);

}  // namespace selenograph::engine
