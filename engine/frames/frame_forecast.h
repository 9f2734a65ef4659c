// Forecasts of a frame that is not drawn: its scene and its shadow errors. Both call the stages of render_frame.
#pragma once

#include <functional>
#include <vector>

#include "engine/cache/render_context.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Prepares what a frame needs and the cache can hold: its terrain, its scene and its light from terrain. The returned
// function tells whether the scene is still cached, and marks it as used. Throws as render_frame does.
std::function<bool()> prepare_frame(const FrameRequest& request, const RenderContext& context);

// Returns FrameReport::shadow_limits_px of the frame that render_frame would make: the only part of a frame that
// depends on the memory for scenes.
std::vector<double> shadow_limits_px(const FrameRequest& request, const RenderContext& context);

}  // namespace selenograph::engine
