#include "engine/frames/frame_selection.h"

#include <algorithm>
#include <limits>
#include <utility>
#include <vector>

#include "dem/base/error.h"
#include "dem/base/wait_clock.h"
#include "engine/frame/needs.h"
#include "engine/scene/anchor.h"
#include "engine/support/stopwatch.h"
#include "engine/visibility/objects/enclosed.h"

namespace selenograph::engine {
namespace {

// Refuses a camera below the terrain, inside a rock or inside an object.
void refuse_hidden(const FrameRequest& request, const RowViews& views, const RenderContext& context) {
  if (request.terrain) refuse_underground(context.terrain, views, context.stop);
  refuse_enclosed(request.terrain ? &context.terrain : nullptr, request.objects, views, context.stop);
}

// Returns the views of the second image of the product "flow"; empty if it is not requested.
std::optional<RowViews> views_of_flow(const FrameRequest& request, const RenderContext& context) {
  std::optional<RowViews> views;
  if (!wants_flow(request)) return views;
  views.emplace(request.camera, *request.flow_to, request.shutter, context.stop);
  try {
    refuse_hidden(request, *views, context);
  } catch (const ImpossibleRequest& e) {
    throw ImpossibleRequest(e.what(), "flow_to");
  }
  return views;
}

Selection select_for(const FrameRequest& request, const RowViews& views, const RowViews* flow_views,
                     const Accuracy& accuracy, const RenderContext& context) {
  if (!request.terrain) return {.blocks = {}, .shadow_limit_px = accuracy.max_shadow_error_px};
  const Visibility visibility = request.shutter ? Visibility::raytrace : request.visibility;
  std::vector<ViewBundle> bundles(views.bundles().begin(), views.bundles().end());
  if (flow_views) bundles.insert(bundles.end(), flow_views->bundles().begin(), flow_views->bundles().end());
  return select_for_views(context.terrain, bundles, wants_light(request) ? &request.sun : nullptr, accuracy,
                          context.stop, {context.cache.capacity(), visibility}, balls_around(request.objects));
}

RocksInView select_rocks(const FrameRequest& request, const FrameSelection& selected, const RenderContext& context) {
  if (!request.terrain) return {};
  const auto in_view = [&](const RowViews& views, const Sun* sun) {
    return rocks_in_view(context.terrain, context.cache.rocks(), views, sun, selected.terrain.blocks,
                         request.accuracy.max_error_px, context.stop);
  };
  RocksInView rocks = in_view(selected.views, wants_light(request) ? &request.sun : nullptr);
  if (selected.flow_views) add_rocks(in_view(*selected.flow_views, nullptr), rocks);
  return rocks;
}

}  // namespace

Selection select_blocks(const FrameRequest& request, const RowViews& views, const Accuracy& accuracy,
                        const RenderContext& context) {
  std::optional<RowViews> flow_views;
  if (request.terrain) flow_views = views_of_flow(request, context);
  return select_for(request, views, flow_views ? &*flow_views : nullptr, accuracy, context);
}

SceneContent content_of(const FrameRequest& request, const RowViews& views, const Selection& selection,
                        const dem::Terrain& terrain) {
  const View& view = views.reference();
  double clearance_m = std::numeric_limits<double>::infinity();
  for (const ViewBundle& bundle : views.bundles())
    clearance_m =
        std::min(clearance_m, bundle.view.position().norm() - bundle.shift_m - kMoonRadius_m - selection.highest_m);
  return {selection.blocks,
          anchor_for(view.position(), view.middle(), clearance_m, fine_ground(selection.blocks, terrain)),
          visibility_for(request, views, selection), &terrain, selection.soft_corners};
}

FrameSelection select_frame(const FrameRequest& request, const RenderContext& context) {
  Stopwatch watch;
  Waits waits;
  const RenderContext counted{context.terrain, context.cache, context.stop.counting(waits)};
  FrameSelection selected{.views = {request.camera, request.pose, request.shutter, counted.stop}};
  refuse_hidden(request, selected.views, counted);
  selected.flow_views = views_of_flow(request, counted);
  selected.terrain = select_for(request, selected.views, selected.flow_views ? &*selected.flow_views : nullptr,
                                request.accuracy, counted);
  selected.rocks = select_rocks(request, selected, counted);
  selected.objects =
      std::make_unique<const ObjectsInFrame>(request, selected.views, selected.rocks.rocks, counted.stop);
  selected.content = content_of(request, selected.views, selected.terrain, context.terrain);
  selected.times.select_ms = watch.lap_ms();
  selected.times.pyramid_ms = waits.pyramid.ms();
  selected.times.load_ms = waits.load.ms();
  return selected;
}

}  // namespace selenograph::engine
