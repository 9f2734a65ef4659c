#include "engine/frames/frame_moment.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "dem/base/error.h"
#include "engine/frame/needs.h"
#include "engine/radiometry/radiometry.h"
#include "engine/scene/anchor.h"
#include "engine/visibility/image/dense_samples.h"
#include "engine/visibility/objects/enclosed.h"
#include "engine/visibility/raytrace/ray_pass.h"

namespace selenograph::engine {
namespace {

// Of sixteen pixels at a time by rays, of all pixels by z-buffer.
constexpr auto kPixelStages = [](auto& algorithm, auto& pixels) {
  algorithm.find_points(pixels);
  algorithm.find_light(pixels);
  algorithm.find_radiance(pixels);
  algorithm.write_products(pixels);
};

// Refuses a camera below the terrain, inside a rock or inside an object.
void refuse_hidden(const FrameRequest& request, const dem::Terrain& terrain, const RowViews& views,
                   const StopToken& stop) {
  if (request.terrain) refuse_underground(terrain, views, stop);
  refuse_enclosed(request.terrain ? &terrain : nullptr, request.objects, views, stop);
}

RowViews views_above_ground(const FrameRequest& request, const dem::Terrain& terrain, const StopToken& stop) {
  RowViews views(request.camera, request.pose, request.shutter, stop);
  refuse_hidden(request, terrain, views, stop);
  return views;
}

// Of the other image of a flow.
std::optional<RowViews> views_of_flow(const FrameRequest& request, const dem::Terrain& terrain, const StopToken& stop) {
  std::optional<RowViews> views;
  if (!wants_flow(request)) return views;
  views.emplace(request.camera, *request.flow_to, request.shutter, stop);
  try {
    refuse_hidden(request, terrain, *views, stop);
  } catch (const ImpossibleRequest& e) {
    throw ImpossibleRequest(e.what(), "flow_to");
  }
  return views;
}

RocksInView select_rocks(const FrameRequest& request, const RowViews& views, const RowViews* flow_to,
                         const Selection& selection, const dem::Terrain& terrain, const RenderCache& kept,
                         const StopToken& stop) {
  if (!request.terrain) return {};
  const Sun* sun = wants_light(request) ? &request.sun : nullptr;
  RocksInView seen =
      rocks_in_view(terrain, kept.rocks(), views, sun, selection.blocks, request.accuracy.max_error_px, stop);
  if (!flow_to) return seen;
  RocksInView next =
      rocks_in_view(terrain, kept.rocks(), *flow_to, nullptr, selection.blocks, request.accuracy.max_error_px, stop);
  add_rocks(std::move(next), seen);
  return seen;
}

// `job` is what the writer's pixels were drawn from.
Drawn drawn_by(const FrameWriter& writer, const FrameJob& job, FrameProducts& out) {
  Drawn drawn;
  drawn.sources = writer.sources().resolve(out.source);
  drawn.counts = writer.counts();
  drawn.pixels = static_cast<double>(job.request.camera.width) * job.request.camera.height;
  for (std::size_t mark = 0; mark < drawn.met.size(); ++mark)
    drawn.met[mark] = writer.marks().hit_of(mark, job.views, job.scene.mesh);
  return drawn;
}

}  // namespace

Selection select_blocks(const FrameRequest& request, const RowViews& views, const Accuracy& accuracy,
                        const dem::Terrain& terrain, const RenderCache& kept, const StopToken& stop) {
  if (!request.terrain) return {.blocks = {}, .shadow_limit_px = accuracy.max_shadow_error_px};
  const Visibility visibility = request.shutter ? Visibility::raytrace : request.visibility;
  std::vector<ViewBundle> bundles(views.bundles().begin(), views.bundles().end());
  if (const auto flow_to = views_of_flow(request, terrain, stop))
    bundles.insert(bundles.end(), flow_to->bundles().begin(), flow_to->bundles().end());
  return select_for_views(terrain, bundles, wants_light(request) ? &request.sun : nullptr, accuracy, stop,
                          {kept.capacity(), visibility}, balls_around(request.objects));
}

SceneContent content_of(const FrameRequest& request, const RowViews& views, const Selection& selection,
                        const dem::Terrain& terrain) {
  const View& view = views.reference();
  double clearance_m = std::numeric_limits<double>::infinity();
  for (const ViewBundle& some : views.bundles())
    clearance_m =
        std::min(clearance_m, some.view.position().norm() - some.shift_m - kMoonRadius_m - selection.highest_m);
  return {selection.blocks,
          anchor_for(view.position(), view.middle(), clearance_m, fine_ground(selection.blocks, terrain)),
          visibility_for(request, views, selection), &terrain, selection.beside_coarser};
}

FrameMoment::FrameMoment(const FrameRequest& request, const dem::Terrain& terrain, RenderCache& kept,
                         const StopToken& stop)
    : request_(request),
      terrain_(terrain),
      kept_(kept),
      stop_(stop.counting(waits_)),
      views_(views_above_ground(request, terrain, stop_)),
      flow_to_(views_of_flow(request, terrain, stop_)),
      selection_(select_blocks(request, views_, request.accuracy, terrain, kept, stop_)),
      rocks_(select_rocks(request, views_, flow_to(), selection_, terrain, kept, stop_)),
      objects_(request, views_, rocks_.rocks, stop_),
      radiance_(radiance_terms(request)),
      content_(content_of(request, views_, selection_, terrain)) {
  times_.select_ms = watch_.lap_ms();
}

void FrameMoment::make_scene(std::size_t draws) {
  work_ = work_of(request_, request_.accuracy, content_.visibility, triangles_of(selection_),
                  /*build=*/!kept_.holds(content_));
  kept_.speed(content_.visibility).refuse_hopeless(work_, draws, "fewer pixels or samples take less", stop_);
  scene_ = kept_.scene(content_, stop_);
  times_.build_ms = watch_.lap_ms();
  times_.pyramid_ms = waits_.pyramid.ms(), times_.load_ms = waits_.load.ms();
  lens_ = kept_.lens(views_.camera(), stop_);
  if (!wants_indirect(request_)) return;
  indirect_.emplace(request_,
                    ViewOfGround{views_, scene_->mesh, balls_around(request_.objects), objects_.balls_around_rocks()},
                    std::nullopt, terrain_, radiance_.direct_w_m2, kept_.light_tiles(), stop_);
  times_.indirect_ms = watch_.lap_ms();
}

Drawn FrameMoment::draw(int margin_px, const EachSample& each, FrameProducts& out) {
  const FrameJob job{
      request_, views_, *scene_, objects_, radiance_, *lens_, stop_, each, indirect_ ? &*indirect_ : nullptr,
      flow_to()};
  const ViewMarks marks(views_, margin_px);
  const bool dense = drawn_at_once(request_, request_.accuracy, content_.visibility) > 1;
  Drawn drawn = dense ? draw_dense(job, marks, out) : draw_centres(job, marks, out);
  drawn.triangles = scene_->triangles, drawn.scene_bytes = scene_->bytes;
  if (indirect_) drawn.ground_view = indirect_->most_ground_view();
  indirect_.reset(),
      scene_.reset();  // an exposure's other moments have their own: who waits for room for one holds none
  kept_.settle();
  times_.visibility_ms = watch_.lap_ms();
  kept_.speed(content_.visibility).learn(work_, times_);
  return drawn;
}

Drawn FrameMoment::draw_centres(const FrameJob& job, const ViewMarks& marks, FrameProducts& out) {
  FrameWriter writer(job.request, views_, job.scene.mesh, catalogue_size(), out, stop_);
  writer.set_marks(marks);
  writer.set_light({radiance_.direct_w_m2, job.indirect});
  draw_pixels(job, writer);
  return drawn_by(writer, job, out);
}

// Radiance of four samples of a pixel at once, the other products by its centre.
Drawn FrameMoment::draw_dense(const FrameJob& job, const ViewMarks& marks, FrameProducts& out) {
  FrameRequest at_centres = job.request;
  at_centres.products &= ~static_cast<ProductSet>(kRadiance | kImage);
  std::optional<Drawn> drawn;
  if (at_centres.products)
    drawn = draw_centres(
        {at_centres, views_, job.scene, objects_, radiance_, job.centres, stop_, job.each, job.indirect, job.flow_to},
        marks, out);
  const std::shared_ptr<const PixelRays> lens = kept_.lens(dense_camera(job.request.camera), stop_);
  DenseSamples samples(job, *lens, catalogue_size());
  samples.writer().set_marks(marks.dense());
  draw_pixels(samples.job(), samples.writer());
  out.radiance = samples.radiance();
  return drawn ? *std::move(drawn) : drawn_by(samples.writer(), samples.job(), out);
}

void FrameMoment::draw_pixels(const FrameJob& job, FrameWriter& writer) {
  if (!job.scene.raster) return RayPass(job, writer).for_pixels(kPixelStages);
  const Pool<FrameScratch>::Lease scratch(kept_.scratch());
  RasterPass(job, writer, *scratch, times_).for_pixels(kPixelStages);
}

}  // namespace selenograph::engine
