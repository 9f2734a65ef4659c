// Chooses the accuracy of a frame with a time budget.
#pragma once

#include "engine/cache/budget.h"
#include "engine/cache/render_context.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

// Returns the setting with the least expected error that is predicted to take no longer than budget_ms, with at most
// max_samples per pixel; the coarsest setting if none fits. The time spent on choosing counts. Runs in the caller's
// task arena; throws as Renderer::choose does.
BudgetChoice choose_accuracy(const FrameRequest& request, double budget_ms, int max_samples,
                             const RenderContext& context);

}  // namespace selenograph::engine
