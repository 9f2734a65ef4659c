// Report stage: what is known about a frame besides its pixels.
#pragma once

#include "engine/frame/frame.h"
#include "engine/frames/frame_drawing.h"
#include "engine/frames/frame_plan.h"
#include "engine/frames/frame_selection.h"

namespace selenograph::engine {

// Completes the report of an exposed frame. `selected`, `drawing`: of the instant that the products show.
FrameReport report_frame(const FramePlan& plan, const FrameSelection& selected, const FrameDrawing& drawing,
                         const dem::Terrain& terrain, FrameReport exposed);

}  // namespace selenograph::engine
