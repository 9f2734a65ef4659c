// One instant of a frame: the stages from the terrain to the products of its pixels.
#pragma once

#include <array>
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "dem/support/stop_token.h"
#include "dem/support/wait_clock.h"
#include "dem/terrain/terrain.h"
#include "engine/camera/row_views.h"
#include "engine/frame/frame.h"
#include "engine/frame/request.h"
#include "engine/render_cache.h"
#include "engine/scene/selection.h"
#include "engine/support/stopwatch.h"
#include "engine/visibility/image/frame_job.h"
#include "engine/visibility/image/frame_writer.h"
#include "engine/visibility/image/view_marks.h"
#include "engine/visibility/objects/objects_in_frame.h"
#include "engine/visibility/objects/rocks_in_view.h"

namespace selenograph::engine {

// Which blocks of the terrain, how fine. None where the objects are alone.
Selection select_blocks(const FrameRequest& request, const RowViews& views, const Accuracy& accuracy,
                        const dem::Terrain& terrain, const RenderCache& kept, const StopToken& stop);

// What the scene of a selection is made of.
SceneContent content_of(const FrameRequest& request, const RowViews& views, const Selection& selection,
                        const dem::Terrain& terrain);

// What is known of the pixels that were drawn, besides their products.
struct Drawn {
  std::vector<dem::SourceIndex> sources;  // that the product `source` numbers
  PixelCounts counts;
  double pixels = 0;  // that were counted
  std::array<std::optional<ViewMarks::Met>, ViewMarks::kCount> met;
  std::size_t triangles = 0, scene_bytes = 0;
};

// Its stages are called in this order, each once.
class FrameMoment {
 public:
  // Select. What is given outlives it. Throws as Renderer::render does, as the other stages do.
  FrameMoment(const FrameRequest& request, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop);

  // Scene: the blocks as one mesh, with what the visibility algorithm needs of it. Refuses when so many draws of such
  // a scene would by far take longer than the request has time.
  void make_scene(std::size_t draws);

  // Draw: visible points, light, radiance, products. Lets the scene go. `margin_px`: of the image within the frame;
  // `each` may be empty.
  Drawn draw(int margin_px, const EachSample& each, FrameProducts& out);

  const RowViews& views() const { return views_; }
  const Selection& selection() const { return selection_; }
  const RocksInView& rocks() const { return rocks_; }
  Visibility visibility() const { return content_.visibility; }
  // Where its camera's pixels look.
  const PixelRays& lens() const { return *lens_; }
  const StageTimes& times() const { return times_; }

 private:
  Drawn draw_centres(const FrameJob& job, const ViewMarks& marks, FrameProducts& out);
  Drawn draw_dense(const FrameJob& job, const ViewMarks& marks, FrameProducts& out);
  void draw_pixels(const FrameJob& job, FrameWriter& writer);
  std::size_t catalogue_size() const { return terrain_.catalogue().rasters().size(); }

  const FrameRequest& request_;
  const dem::Terrain& terrain_;
  RenderCache& kept_;
  Waits waits_;
  StopToken stop_;
  Stopwatch watch_;
  StageTimes times_;
  RowViews views_;
  Selection selection_;
  RocksInView rocks_;
  ObjectsInFrame objects_;
  RadianceTerms radiance_;
  SceneContent content_;
  FrameWork work_;
  std::shared_ptr<const Scene> scene_;
  std::shared_ptr<const PixelRays> lens_;
};

}  // namespace selenograph::engine
