// One instant of a frame: the stages from terrain to pixel products.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/base/wait_clock.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/render_cache.h"
#include "engine/camera/row_views.h"
#include "engine/frame/frame.h"
#include "engine/frame/request.h"
#include "engine/scene/selection.h"
#include "engine/support/stopwatch.h"
#include "engine/visibility/image/frame_job.h"
#include "engine/visibility/image/frame_writer.h"
#include "engine/visibility/image/view_marks.h"
#include "engine/visibility/objects/objects_in_frame.h"
#include "engine/visibility/objects/rocks_in_view.h"

namespace selenograph::engine {

// Selects the terrain blocks and their levels, for both images of a flow. None when the request has no terrain.
Selection select_blocks(const FrameRequest& request, const RowViews& views, const Accuracy& accuracy,
                        const dem::Terrain& terrain, const RenderCache& kept, const StopToken& stop);

// Content of a selection's scene, the key of the scene cache.
SceneContent content_of(const FrameRequest& request, const RowViews& views, const Selection& selection,
                        const dem::Terrain& terrain);

// Statistics of the drawn pixels.
struct Drawn {
  std::vector<dem::SourceIndex> sources;  // the product `source` holds indices into it
  PixelCounts counts;
  double pixels = 0;  // number of counted pixels
  std::array<std::optional<ViewMarks::MarkHit>, ViewMarks::kCount> met;
  std::size_t triangles = 0, scene_bytes = 0;
  double ground_view = 0;
};

// The stages are called in this order, each once.
class FrameMoment {
 public:
  // Select stage. The arguments must outlive this object. Throws as Renderer::render does, as do the other stages.
  FrameMoment(const FrameRequest& request, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop);

  // Scene stage: joins the blocks to one mesh with the structures of the visibility algorithm. Throws TooMuchWork when
  // `draws` draws of it would take much longer than the request has time.
  void make_scene(std::size_t draws);

  // Draw stage: visible points, light, radiance, products. Releases the scene. `margin_px`: margin of the frame around
  // the image; `each` may be empty.
  Drawn draw(int margin_px, const EachSample& each, FrameProducts& out);

  const RowViews& views() const { return views_; }
  const Selection& selection() const { return selection_; }
  const RocksInView& rocks() const { return rocks_; }
  Visibility visibility() const { return content_.visibility; }
  // Directions of the camera's pixels.
  const PixelRays& lens() const { return *lens_; }
  const StageTimes& times() const { return times_; }

 private:
  Drawn draw_centres(const FrameJob& job, const ViewMarks& marks, FrameProducts& out);
  Drawn draw_dense(const FrameJob& job, const ViewMarks& marks, FrameProducts& out);
  void draw_pixels(const FrameJob& job, FrameWriter& writer);
  const RowViews* flow_to() const { return flow_to_ ? &*flow_to_ : nullptr; }
  std::size_t catalogue_size() const { return terrain_.catalogue().rasters().size(); }

  const FrameRequest& request_;
  const dem::Terrain& terrain_;
  RenderCache& kept_;
  Waits waits_;
  StopToken stop_;
  Stopwatch watch_;
  StageTimes times_;
  RowViews views_;
  std::optional<RowViews> flow_to_;
  Selection selection_;
  RocksInView rocks_;
  ObjectsInFrame objects_;
  RadianceTerms radiance_;
  SceneContent content_;
  FrameWork work_;
  std::shared_ptr<const Scene> scene_;
  std::shared_ptr<const PixelRays> lens_;
  std::optional<TerrainLight> indirect_;
};

}  // namespace selenograph::engine
