// Select stage: the terrain, rocks and objects that one instant of a frame sees or that cast shadows into it.
#pragma once

#include <memory>
#include <optional>

#include "engine/cache/render_context.h"
#include "engine/camera/row_views.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"
#include "engine/scene/selection.h"
#include "engine/visibility/objects/objects_in_frame.h"
#include "engine/visibility/objects/rocks_in_view.h"
#include "engine/visibility/points/scene.h"

namespace selenograph::engine {

struct FrameSelection {
  RowViews views;
  std::optional<RowViews> flow_views{};  // of the second image of the product "flow"
  Selection terrain{};                   // blocks and their levels
  RocksInView rocks{};
  std::unique_ptr<const ObjectsInFrame> objects{};  // the request's objects and the rocks
  SceneContent content{};                           // key of the scene in the cache
  StageTimes times{};
};

// Selects for the request's pose. The result refers to `request`. Throws as Renderer::render does.
FrameSelection select_frame(const FrameRequest& request, const RenderContext& context);

// Selects the terrain's blocks and their levels, for both images of a flow. Empty when the request has no terrain.
Selection select_blocks(const FrameRequest& request, const RowViews& views, const Accuracy& accuracy,
                        const RenderContext& context);

// Returns the content of a selection's scene.
SceneContent content_of(const FrameRequest& request, const RowViews& views, const Selection& selection,
                        const dem::Terrain& terrain);

}  // namespace selenograph::engine
