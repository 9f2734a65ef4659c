// Scene and draw stages: from selected terrain to pixels of one instant of a frame.
#pragma once

#include <array>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "engine/cache/budget.h"
#include "engine/cache/render_context.h"
#include "engine/camera/pixel_rays.h"
#include "engine/frame/products.h"
#include "engine/frame/report.h"
#include "engine/frame/request.h"
#include "engine/frames/frame_selection.h"
#include "engine/indirect/terrain_light.h"
#include "engine/visibility/image/frame_job.h"
#include "engine/visibility/image/frame_writer.h"
#include "engine/visibility/image/view_marks.h"

namespace selenograph::engine {

// The selected blocks as one mesh, with what the draw stage needs besides it. The cache cannot evict the mesh while
// this exists: do not wait for another scene (RenderCache::scene).
struct FrameScene {
  std::shared_ptr<const Scene> cached;
  std::shared_ptr<const PixelRays> pixel_rays;        // directions of the camera's pixels
  std::unique_ptr<const TerrainLight> terrain_light;  // null: not requested
  RadianceTerms radiance;
  FrameWork work;  // predicted cost of drawing it
  StageTimes times;
};

// Scene stage. `draws`: number of scenes like this one that the frame draws; throws TooMuchWork when they would take
// much longer than the request has time. The result refers to its arguments. Throws as Renderer::render does.
FrameScene make_scene(const FrameRequest& request, const FrameSelection& selected, std::size_t draws,
                      const RenderContext& context);

// Pixels of one instant, and what is known about them.
struct FrameDrawing {
  FrameProducts products;
  std::vector<dem::SourceIndex> sources;  // the product `source` holds indices into it
  PixelCounts counts;
  double pixels = 0;                                                   // number of counted pixels
  std::array<std::optional<ViewMarks::Met>, ViewMarks::kCount> marks;  // terrain at the boresight and the corners
  std::size_t triangles = 0, scene_bytes = 0;
  double ground_view = 0;  // TerrainLight::most_ground_view
  StageTimes times;
};

// Draw stage: visible points, light, radiance, products. Releases the scene. `margin_px`: margin of the request's
// camera around the image; `each` may be empty. Throws as Renderer::render does.
FrameDrawing draw_frame(const FrameRequest& request, const FrameSelection& selected, FrameScene scene, int margin_px,
                        const EachSample& each, const RenderContext& context);

}  // namespace selenograph::engine
