#include "engine/frames/frame_drawing.h"

#include <utility>

#include "dem/base/wait_clock.h"
#include "engine/frame/needs.h"
#include "engine/radiometry/radiometry.h"
#include "engine/support/stopwatch.h"
#include "engine/visibility/image/dense_samples.h"
#include "engine/visibility/raytrace/ray_pass.h"
#include "engine/visibility/zbuffer/raster_pass.h"

namespace selenograph::engine {
namespace {

// Runs the four stages of drawing. Ray tracing calls it per packet of sixteen pixels, the z-buffer once per image.
constexpr auto kPixelStages = [](auto& algorithm, auto& pixels) {
  algorithm.find_points(pixels);
  algorithm.find_light(pixels);
  algorithm.find_radiance(pixels);
  algorithm.write_products(pixels);
};

// Summarises the pixels that the writer wrote for `job`: sources, counts, marks.
FrameDrawing summarise_pixels(const FrameWriter& writer, const FrameJob& job, FrameProducts products) {
  FrameDrawing drawing;
  drawing.products = std::move(products);
  drawing.sources = writer.sources().resolve(drawing.products.source);
  drawing.counts = writer.counts();
  drawing.pixels = static_cast<double>(job.request.camera.width) * job.request.camera.height;
  for (std::size_t mark = 0; mark < drawing.marks.size(); ++mark)
    drawing.marks[mark] = writer.marks().hit_of(mark, job.views, job.scene.mesh);
  return drawing;
}

void draw_pixels(const FrameJob& job, FrameWriter& writer, RenderCache& cache, StageTimes& times) {
  if (!job.scene.raster) {
    RayPass(job, writer).for_pixels(kPixelStages);
    return;
  }
  const Pool<FrameScratch>::Lease scratch(cache.scratch());
  RasterPass(job, writer, *scratch, times).for_pixels(kPixelStages);
}

std::size_t catalogue_size(const RenderContext& context) { return context.terrain.catalogue().rasters().size(); }

FrameDrawing draw_centres(const FrameJob& job, const ViewMarks& marks, const RenderContext& context,
                          StageTimes& times) {
  FrameProducts products;
  FrameWriter writer(job.request, job.views, job.scene.mesh, catalogue_size(context), products, job.stop);
  writer.set_marks(marks);
  writer.set_light({job.radiance.direct_w_m2, job.indirect});
  draw_pixels(job, writer, context.cache, times);
  return summarise_pixels(writer, job, std::move(products));
}

// Renders radiance with four samples per pixel. All other products are sampled at the pixel's centre.
FrameDrawing draw_dense(const FrameJob& job, const ViewMarks& marks, const RenderContext& context, StageTimes& times) {
  FrameRequest request_at_centres = job.request;
  request_at_centres.products &= ~static_cast<ProductSet>(kRadiance | kImage);
  std::optional<FrameDrawing> centres;
  if (request_at_centres.products) {
    const FrameJob job_at_centres{request_at_centres, job.views, job.scene, job.objects,  job.radiance,
                                  job.centres,        job.stop,  job.each,  job.indirect, job.flow_to};
    centres = draw_centres(job_at_centres, marks, context, times);
  }
  const std::shared_ptr<const PixelRays> rays = context.cache.lens(dense_camera(job.request.camera), job.stop);
  DenseSamples samples(job, *rays, catalogue_size(context));
  samples.writer().set_marks(marks.dense());
  draw_pixels(samples.job(), samples.writer(), context.cache, times);
  FrameDrawing drawing = centres ? *std::move(centres) : summarise_pixels(samples.writer(), samples.job(), {});
  drawing.products.radiance = samples.radiance();
  return drawing;
}

}  // namespace

FrameScene make_scene(const FrameRequest& request, const FrameSelection& selected, std::size_t draws,
                      const RenderContext& context) {
  Stopwatch watch;
  Waits waits;
  const StopToken stop = context.stop.counting(waits);
  const SceneContent& content = selected.content;
  RenderCache& cache = context.cache;
  FrameScene scene;
  scene.work = work_of(request, request.accuracy, content.visibility, triangles_of(selected.terrain),
                       /*build=*/!cache.holds(content));
  cache.speed(content.visibility).refuse_hopeless(scene.work, draws, "fewer pixels or samples take less", stop);
  // Get the lens before the scene, which the cache cannot evict while this frame waits.
  scene.pixel_rays = cache.lens(selected.views.camera(), stop);
  scene.times.visibility_ms = watch.lap_ms();
  scene.cached = cache.scene(content, stop);
  scene.times.build_ms = watch.lap_ms();
  scene.times.pyramid_ms = waits.pyramid.ms();
  scene.times.load_ms = waits.load.ms();
  scene.radiance = radiance_terms(request);
  if (!wants_indirect(request)) return scene;
  const std::vector<Ball> objects = balls_around(request.objects);
  const std::vector<Ball> rocks = selected.objects->balls_around_rocks();
  scene.terrain_light = std::make_unique<const TerrainLight>(
      request, ViewOfGround{selected.views, scene.cached->mesh, objects, rocks}, std::nullopt, context.terrain,
      scene.radiance.direct_w_m2, cache.light_tiles(), stop);
  scene.times.indirect_ms = watch.lap_ms();
  scene.times.light = scene.terrain_light->times();
  return scene;
}

FrameDrawing draw_frame(const FrameRequest& request, const FrameSelection& selected, FrameScene scene, int margin_px,
                        const EachSample& each, const RenderContext& context) {
  Stopwatch watch;
  const FrameJob job{request,
                     selected.views,
                     *scene.cached,
                     *selected.objects,
                     scene.radiance,
                     *scene.pixel_rays,
                     context.stop,
                     each,
                     scene.terrain_light.get(),
                     selected.flow_views ? &*selected.flow_views : nullptr};
  const ViewMarks marks(selected.views, margin_px);
  const Visibility visibility = selected.content.visibility;
  StageTimes times;
  const bool is_dense = drawn_at_once(request, request.accuracy, visibility) > 1;
  FrameDrawing drawing = is_dense ? draw_dense(job, marks, context, times) : draw_centres(job, marks, context, times);
  drawing.triangles = scene.cached->triangles;
  drawing.scene_bytes = scene.cached->bytes;
  if (scene.terrain_light) drawing.ground_view = scene.terrain_light->max_ground_view();
  // Release the scene here, not with the argument, which may live to the end of the caller's expression: the next
  // exposure sample reserves its own, and two samples that each hold one and wait for another would deadlock.
  scene.terrain_light.reset();
  scene.cached.reset();
  context.cache.settle();
  times.visibility_ms = watch.lap_ms();
  drawing.times = scene.times;
  drawing.times += times;
  context.cache.speed(visibility).learn(scene.work, drawing.times);
  return drawing;
}

}  // namespace selenograph::engine
