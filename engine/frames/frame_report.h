// Writes the metadata of a drawn frame.
#pragma once

#include "engine/frame/frame.h"
#include "engine/frames/frame_moment.h"
#include "engine/frames/frame_plan.h"

namespace selenograph::engine {

// `moment`: the one shown by the products.
void report_frame(const FramePlan& plan, const FrameMoment& moment, const Drawn& drawn, const dem::Terrain& terrain,
                  Frame& frame);

}  // namespace selenograph::engine
