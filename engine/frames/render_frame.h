// The stages of a frame on one page, in the order of the paper.
#pragma once

#include "engine/cache/render_context.h"
#include "engine/frame/frame.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Implements Renderer::render.
Frame render_frame(const FrameRequest& request, const RenderContext& context);

}  // namespace selenograph::engine
