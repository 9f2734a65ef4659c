#include "engine/render_frame.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "engine/frame/needs.h"
#include "engine/motion_blur.h"
#include "engine/radiometry/radiometry.h"
#include "engine/sensor/sensor.h"
#include "engine/support/stopwatch.h"
#include "engine/visibility/image/dense_samples.h"
#include "engine/visibility/image/frame_writer.h"
#include "engine/visibility/objects/rocks_in_view.h"
#include "engine/visibility/raytrace/ray_pass.h"

namespace selenograph::engine {
namespace {

// The frame's own list of sources, in the catalogue's order, and `source` as indices into it.
void list_sources(const dem::Catalogue& catalogue, const FrameSources& sources, Frame& frame) {
  for (const dem::SourceIndex raster : sources.settle(frame.products.source))
    frame.report.sources.push_back(source_tile(catalogue.rasters()[raster]));
}

void report_scene(const Selection& selection, const Scene& scene, FrameReport& out) {
  out.lod_error_px = selection.error_px, out.lod_error_m = selection.error_m;
  out.detail_error_px = selection.detail_error_px, out.detail_limit_px = selection.detail_limit_px;
  out.shadow_error_px = selection.shadow_error_px;
  out.shadow_limits_px.insert(out.shadow_limits_px.begin(), selection.shadow_limit_px);
  out.min_post_spacing_m = selection.min_spacing_m, out.max_post_spacing_m = selection.max_spacing_m;
  out.triangles = scene.triangles, out.scene_bytes = scene.bytes;
}

void report_pixels(const Camera& camera, const PixelCounts& counts, FrameReport& out) {
  const double pixels = static_cast<double>(camera.width) * camera.height;
  out.hit_fraction = static_cast<double>(counts.hit) / pixels;
  out.object_fraction = static_cast<double>(counts.on_object) / pixels;
  out.rock_fraction = static_cast<double>(counts.on_rock) / pixels;
  out.missing_fraction = static_cast<double>(counts.missing) / pixels;
  out.filled_fraction = static_cast<double>(counts.filled) / pixels;
  out.blended_fraction = static_cast<double>(counts.blended) / pixels;
}

double azimuth_deg(const EastNorthUp& local, const Vec3& direction) {
  const double degrees = std::atan2(direction.dot(local.east), direction.dot(local.north)) * kDegreesPerRadian;
  return degrees < 0 ? degrees + 360 : degrees;
}

// The angle across a pixel in the middle of the boresight.
double pixel_rad(const View& view) {
  const Camera& camera = view.camera();
  const auto left = view.ray(camera.cx - 0.5, camera.cy), right = view.ray(camera.cx + 0.5, camera.cy);
  return left && right ? std::atan2(left->cross(*right).norm(), left->dot(*right)) : 0;
}

// `drawn`: the frame that the marks' pixels were of.
void report_view(const ViewMarks& marks, const FrameJob& drawn, const View& view, const dem::Catalogue& catalogue,
                 ViewReport& out) {
  const Vec3& sun = drawn.request.sun.direction;
  const auto met_at = [&](std::size_t mark) { return marks.met(mark, drawn.views, drawn.scene.mesh); };
  const Vec3 boresight = view.moon_from_camera().col(2), up = -view.moon_from_camera().col(1);
  const Vec3 down = -view.position();
  out.off_nadir_deg = std::atan2(boresight.cross(down).norm(), boresight.dot(down)) * kDegreesPerRadian;
  for (std::size_t i = 0; i < out.corners.size(); ++i)
    if (const auto met = met_at(ViewMarks::kFirstCorner + i)) out.corners[i] = to_geographic(met->position_m);
  const auto met = met_at(ViewMarks::kBoresight);
  if (!met) return;
  out.boresight = to_geographic(met->position_m);
  const EastNorthUp local = local_axes(met->position_m);
  // Where the ground is that is a little farther up in the image.
  const double falls = met->direction.dot(local.up);
  if (falls != 0) out.up_azimuth_deg = azimuth_deg(local, up - up.dot(local.up) / falls * met->direction);
  out.sun_azimuth_deg = azimuth_deg(local, sun);
  out.sun_elevation_deg = std::asin(std::clamp(sun.dot(local.up), -1.0, 1.0)) * kDegreesPerRadian;
  const double pixel_m = pixel_rad(view) * (met->position_m - view.position()).norm();
  if (met->source != dem::kNoSource && pixel_m > 0)
    out.post_px = catalogue.rasters()[met->source].post_spacing_m / pixel_m;
}

// A sensor's model sees a little more than its image shows: rows before the first one, too.
FrameRequest with_margin_of(const std::optional<Sensor>& sensor, FrameRequest request) {
  if (!sensor) return request;
  request.camera = with_margin(request.camera, sensor->margin_px());
  if (request.shutter) request.shutter->first_row -= sensor->margin_px();
  if (request.truth) request.truth->x += sensor->margin_px(), request.truth->y += sensor->margin_px();
  return request;
}

RowViews views_of(const FrameRequest& request, const StopToken& stop) {
  return {request.camera, request.pose, request.shutter, stop};
}

std::optional<Sensor> sensor_of(const FrameRequest& request, const StopToken& stop) {
  std::optional<Sensor> sensor;
  if (request.sensor && request.products & kImage) sensor.emplace(request, stop);
  return sensor;
}

Frame render_samples(const FrameRequest& asked, const dem::Terrain& terrain, RenderCache& kept, const StopToken& token,
                     const EachSample& each);

double longest_streak(const FrameRequest& request, const Selection& selection, double integration_time_s,
                      const dem::Terrain& terrain, const StopToken& stop) {
  double ground_m = selection.highest_m;
  if (request.terrain && request.pose.position_m.norm() < kMoonRadius_m + ground_m) {
    const Geographic below = to_geographic(request.pose.position_m);
    const double height_m = terrain.height(below.lat_deg, below.lon_deg, stop).height_m;
    ground_m = std::isnan(height_m) ? double{dem::kLowestRelief_m} : height_m;
  }
  return longest_streak_px(request, integration_time_s, ground_m, balls_around(request.objects));
}

// Where the frame decides, what it may decide at most.
double longest_exposure_s(const SensorModel& sensor) {
  return sensor.exposure.target_fill > 0 ? sensor.exposure.longest_s : sensor.detector.integration_time_s;
}

// What a sensor makes its image of.
struct Exposed {
  Sensor& sensor;
  const FrameRequest& request;  // with the sensor's margin, in the band that it counts
  const Camera& camera;         // of its views
  const PixelRays& lens;
  const StopToken& stop;

  // The samples of a moment that is such a share of the exposure; nothing where the sensor doesn't want them.
  EachSample collect(float share) const {
    if (!sensor.wants_samples()) return {};
    return [this, share](const SubpixelSample& sample, const std::vector<float>& radiance) {
      sensor.add_sample(camera, lens, sample, share, radiance, stop);
    };
  }
};

// Radiance as a mean over the exposure, whose middle is rendered already. The time of the others counts as if it were
// the frame's own.
std::vector<float> radiance_in_motion(const Exposed& exposed, int samples, const std::vector<float>& in_the_middle,
                                      const dem::Terrain& terrain, RenderCache& kept, StageTimes& times,
                                      std::vector<double>& shadow_limits_px) {
  FrameRequest request = exposed.request;
  const Motion& motion = exposed.request.sensor->motion;
  const Pose middle = request.pose;
  request.products = kRadiance;
  std::vector<float> mean(in_the_middle.size(), 0.F);
  const float share = 1.F / static_cast<float>(samples);
  const auto add = [&](const std::vector<float>& radiance) {
    for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += share * radiance[i];
  };
  for (const double moment : moments_of(samples, exposed.sensor.integration_time_s())) {
    exposed.stop.check();
    if (moment == 0 && !exposed.sensor.wants_samples()) {
      add(in_the_middle);
      continue;
    }
    request.pose = moved(middle, motion, moment);
    const EachSample each = exposed.collect(share);
    const Frame frame = render_samples(request, terrain, kept, exposed.stop, each);
    shadow_limits_px.push_back(frame.report.shadow_limits_px.front());
    times.visibility_ms += frame.times.visibility_ms, times.select_ms += frame.times.select_ms;
    times.build_ms += frame.times.build_ms;
    times.pyramid_ms += frame.times.pyramid_ms, times.load_ms += frame.times.load_ms;
    add(frame.products.radiance);
  }
  return mean;
}

// The image by a sensor's model, of a frame that was rendered with its margin, which all products lose.
void capture(Sensor& sensor, const FrameRequest& request, const Camera& camera, const PixelRays& lens,
             std::vector<float> radiance, Frame& frame, const StopToken& stop) {
  sensor.image(camera, lens, std::move(radiance), frame.products.image, stop);
  frame.report.integration_time_s = sensor.integration_time_s();
  frame.report.saturated_fraction = sensor.saturated_fraction();
  frame.report.smear_fill = sensor.smear_fill();
  crop(frame.products, request.camera, sensor.margin_px(), request.truth.has_value());
  frame.report.full_scale_radiance_w_m2_sr = sensor.full_scale_radiance_w_m2_sr();
  frame.report.margin_px = sensor.margin_px(), frame.report.captured_fraction = sensor.captured();
}

}  // namespace

Selection select_blocks(const FrameRequest& request, const RowViews& views, const Accuracy& accuracy,
                        const dem::Terrain& terrain, const RenderCache& kept, const StopToken& stop) {
  if (!request.terrain) return {.blocks = {}, .shadow_limit_px = accuracy.max_shadow_error_px};
  const Visibility visibility = request.shutter ? Visibility::raytrace : request.visibility;
  return select_for_views(terrain, views.bundles(), wants_light(request) ? &request.sun : nullptr, accuracy, stop,
                          {kept.capacity(), visibility}, balls_around(request.objects));
}

SceneContent content_of(const FrameRequest& request, const RowViews& views, const Selection& selection,
                        const dem::Terrain& terrain) {
  const View& view = views.reference();
  double clearance_m = std::numeric_limits<double>::infinity();
  for (const ViewBundle& some : views.bundles())
    clearance_m =
        std::min(clearance_m, some.view.position().norm() - some.shift_m - kMoonRadius_m - selection.highest_m);
  return {selection.blocks, anchor_for(view.position(), view.middle(), clearance_m),
          visibility_for(request, views, selection), &terrain};
}

std::vector<double> shadow_limits_px(const FrameRequest& asked, const dem::Terrain& terrain, const RenderCache& kept,
                                     const StopToken& stop) {
  const std::optional<Sensor> sensor = sensor_of(asked, stop);
  FrameRequest request = with_margin_of(sensor, asked);
  const auto selected = [&](const Pose& pose) {
    request.pose = pose;
    return select_blocks(request, views_of(request, stop), request.accuracy, terrain, kept, stop);
  };
  const Selection middle = selected(asked.pose);
  std::vector<double> limits{middle.shadow_limit_px};
  if (!sensor || request.sensor->motion.none()) return limits;
  const Motion& motion = asked.sensor->motion;
  const double time_s = longest_exposure_s(*asked.sensor);
  const int samples = motion_samples(motion, longest_streak(request, middle, time_s, terrain, stop));
  for (const double moment : moments_of(samples, time_s))
    if (moment != 0) limits.push_back(selected(moved(asked.pose, motion, moment)).shadow_limit_px);
  return limits;
}

std::function<bool()> prepare_frame(const FrameRequest& asked, const dem::Terrain& terrain, RenderCache& kept,
                                    const StopToken& stop) {
  const FrameRequest request = with_margin_of(sensor_of(asked, stop), asked);
  const RowViews views = views_of(request, stop);
  const Selection selection = select_blocks(request, views, request.accuracy, terrain, kept, stop);
  const SceneContent content = content_of(request, views, selection, terrain);
  kept.scene(content, stop, RenderCache::Purpose::preparation);
  return kept.use_of(content);
}

namespace {

Frame render_samples(const FrameRequest& asked, const dem::Terrain& terrain, RenderCache& kept, const StopToken& token,
                     const EachSample& asked_each) {
  Waits waits;
  const StopToken stop = token.counting(waits);
  std::optional<Sensor> sensor = sensor_of(asked, stop);
  const FrameRequest request = with_margin_of(sensor, asked);

  Frame frame;
  Stopwatch watch;
  const RowViews views = views_of(request, stop);
  if (request.terrain) refuse_underground(terrain, views, stop);
  const RadianceTerms radiance = radiance_terms(request);
  frame.report.emits_elsewhere = objects_emit(request.objects) || !request.temperature_maps.empty();
  // Light of a spectrum of its own is counted in photons by a frame of its own.
  std::optional<Band> photons;
  if (sensor) photons = sensor->photon_band(!request.atmosphere && !radiance.emitted && !frame.report.emits_elsewhere);

  // Selection: which blocks of the terrain, how fine; what may shade them.
  const Selection selection = select_blocks(request, views, request.accuracy, terrain, kept, stop);
  const RocksInView rocks = request.terrain
                                ? rocks_in_view(terrain, views, wants_light(request) ? &request.sun : nullptr,
                                                selection.blocks, request.accuracy.max_error_px, stop)
                                : RocksInView();
  const ObjectsInFrame objects(request, views, rocks.rocks, stop);
  frame.report.rocks = rocks.rocks.size(), frame.report.least_rock_px = rocks.least_px;
  if (request.products & kRock) frame.rocks = rocks.rocks;
  frame.times.select_ms = watch.lap_ms();

  // Scene: the blocks as one mesh, with what the visibility algorithm needs of it.
  const SceneContent content = content_of(request, views, selection, terrain);
  const FrameWork work = work_of(request, request.accuracy, content.visibility, triangles_of(selection),
                                 /*build=*/!kept.holds(content));
  SpeedGauge& speed = kept.speed(content.visibility);
  const bool moving = sensor && !request.sensor->motion.none();
  // Where the frame chooses its exposure, it is not known yet, and not what is refused.
  const int expected =
      moving ? motion_samples(request.sensor->motion,
                              longest_streak(request, selection, sensor->integration_time_s(), terrain, stop))
             : 1;
  const auto moments = static_cast<std::size_t>(expected);
  speed.refuse_hopeless(work, moments + (photons ? 1 : 0), stop);
  std::shared_ptr<const Scene> scene = kept.scene(content, stop);
  frame.times.build_ms = watch.lap_ms();
  frame.times.pyramid_ms = waits.pyramid.ms(), frame.times.load_ms = waits.load.ms();

  // Visible points, light, radiance, products. Each of sixteen pixels at a time by rays, of all pixels by z-buffer.
  const auto stages = [](auto& algorithm, auto& pixels) {
    algorithm.find_points(pixels);
    algorithm.find_light(pixels);
    algorithm.find_radiance(pixels);
    algorithm.write_products(pixels);
  };
  const std::shared_ptr<const PixelRays> lens = kept.lens(views.camera(), stop);
  FrameRequest counted = request;
  if (photons) counted.band = photons, counted.products = kRadiance;
  std::optional<Exposed> exposed;
  if (sensor) exposed.emplace(Exposed{*sensor, counted, views.camera(), *lens, stop});
  {
    const EachSample each = exposed && !moving && !photons ? exposed->collect(1) : asked_each;
    const FrameJob job{request, views, *scene, objects, radiance, *lens, stop, each};
    const std::size_t catalogue_size = terrain.catalogue().rasters().size();
    const ViewMarks marks(views, sensor ? sensor->margin_px() : 0);
    const auto finish = [&](const FrameWriter& writer, const FrameJob& what) {
      list_sources(terrain.catalogue(), writer.sources(), frame);
      report_pixels(what.request.camera, writer.counts(), frame.report);
      report_view(writer.marks(), what, views.reference(), terrain.catalogue(), frame.report.view);
    };
    const auto draw = [&](const FrameJob& what, FrameWriter& writer) {
      if (!scene->raster) return RayPass(what, writer).for_pixels(stages);
      const Pool<FrameScratch>::Lease scratch(kept.scratch());
      RasterPass(what, writer, *scratch, frame.times).for_pixels(stages);
    };
    const bool dense = drawn_at_once(request, request.accuracy, content.visibility) > 1;
    FrameRequest at_centres = request;
    if (dense) at_centres.products &= ~static_cast<ProductSet>(kRadiance | kImage);
    if (!dense || at_centres.products) {
      FrameWriter writer(at_centres, views, scene->mesh, catalogue_size, frame.products, stop);
      writer.look_at(marks);
      draw({at_centres, views, *scene, objects, radiance, *lens, stop, each}, writer);
      finish(writer, job);
    }
    if (dense) {
      const std::shared_ptr<const PixelRays> dense_lens = kept.lens(dense_camera(request.camera), stop);
      DenseSamples samples(job, *dense_lens, catalogue_size);
      samples.writer().look_at(marks.dense());
      draw(samples.job(), samples.writer());
      frame.products.radiance = samples.radiance();
      if (!at_centres.products) finish(samples.writer(), samples.job());
    }
    report_scene(selection, *scene, frame.report);
  }
  scene.reset();  // an exposure's other moments have their own: who waits for room for one holds none
  kept.settle();
  frame.times.visibility_ms = watch.lap_ms();
  speed.learn(work, frame.times);

  // Sensor: from radiance to digital numbers.
  std::vector<float>& pixels = frame.products.radiance;
  if (!pixels.empty())
    frame.report.brightest_w_m2_sr = static_cast<double>(*std::max_element(pixels.begin(), pixels.end()));
  if (sensor) {
    std::vector<float> captured = request.products & kRadiance ? pixels : std::move(pixels);
    if (photons) {
      const EachSample each = moving ? EachSample() : exposed->collect(1);
      captured = render_samples(counted, terrain, kept, stop, each).products.radiance;
    }
    sensor->choose_integration_time(views.camera(), *lens, captured, stop);
    if (moving) {
      frame.report.longest_streak_px = longest_streak(request, selection, sensor->integration_time_s(), terrain, stop);
      frame.report.motion_samples = motion_samples(request.sensor->motion, frame.report.longest_streak_px);
      captured = radiance_in_motion(*exposed, frame.report.motion_samples, captured, terrain, kept, frame.times,
                                    frame.report.shadow_limits_px);
    }
    watch.lap_ms();
    if (!(request.products & kRadiance)) pixels.clear();
    capture(*sensor, request, views.camera(), *lens, std::move(captured), frame, stop);
  } else if (request.products & kImage) {
    frame.report.full_scale_radiance_w_m2_sr = expose(request.image, pixels, frame.products.image);
    frame.report.saturated_fraction = share_above(pixels, frame.report.full_scale_radiance_w_m2_sr);
  }
  if (!(request.products & kRadiance)) pixels = {};
  frame.times.sensor_ms = watch.lap_ms();

  frame.report.visibility = content.visibility;
  frame.report.radiance = radiance;
  if (request.terrain) frame.report.warnings = terrain.warnings_about(selection.replaced);
  return frame;
}

}  // namespace

Frame render_frame(const FrameRequest& asked, const dem::Terrain& terrain, RenderCache& kept, const StopToken& stop) {
  return render_samples(asked, terrain, kept, stop, {});
}

}  // namespace selenograph::engine
