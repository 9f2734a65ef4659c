#include "engine/frames/choose_accuracy.h"

#include <optional>

#include "dem/base/error.h"
#include "engine/frames/frame_selection.h"
#include "engine/support/stopwatch.h"

namespace selenograph::engine {

BudgetChoice choose_accuracy(const FrameRequest& request, double budget_ms, int max_samples,
                             const RenderContext& context) {
  const RowViews views(request.camera, request.pose, request.shutter, context.stop);
  if (request.terrain) refuse_underground(context.terrain, views, context.stop);
  Stopwatch watch;
  double spent_ms = 0;
  std::optional<BudgetChoice> best;
  for (const double error_px : kBudgetErrors_px) {
    Accuracy setting{.max_error_px = error_px};
    Selection selection;
    try {
      selection = select_blocks(request, views, setting, context);
    } catch (const TooMuchTerrain&) {
      if (!best) throw;
      break;
    }
    const double select_ms = watch.lap_ms();
    spent_ms += select_ms;
    const SceneContent content = content_of(request, views, selection, context.terrain);
    const bool build = !context.cache.holds(content);
    bool any = false;
    for (const int samples : kBudgetSamples) {
      if (samples > max_samples) break;
      setting.samples_per_pixel = samples;
      // Selected once to choose, once to render.
      const FrameWork work = work_of(request, setting, content.visibility, triangles_of(selection), build);
      const double ms = spent_ms + select_ms + context.cache.speed(content.visibility).predicted_ms(work);
      const bool fits = ms <= budget_ms;
      any |= fits;
      prefer(best, {setting, ms, fits});
    }
    if (!any) break;  // finer terrain takes longer still
  }
  return *best;
}

}  // namespace selenograph::engine
