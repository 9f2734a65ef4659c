// The page that names the stages of a frame, in the order of the paper.
#pragma once

#include <functional>
#include <vector>

#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/frame/frame.h"
#include "engine/frame/request.h"
#include "engine/render_cache.h"

namespace selenograph::engine {

// Throws as Renderer::render does. In the caller's task arena.
Frame render_frame(const FrameRequest& request, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop);

// What a frame would need that is kept between frames: its terrain and its scene. What is returned says whether the
// scene still is, and uses it. Throws as render_frame.
std::function<bool()> prepare_frame(const FrameRequest& request, const dem::Terrain& terrain, RenderCache& kept,
                                    const StopToken& stop);

// FrameReport::shadow_limits_px of the frame that render_frame would make: the one thing in it that depends on the
// memory for scenes.
std::vector<double> shadow_limits_px(const FrameRequest& request, const dem::Terrain& terrain, const RenderCache& kept,
                                     const StopToken& stop);

}  // namespace selenograph::engine
