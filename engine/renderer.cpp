#include "engine/renderer.h"

#include <fmt/format.h>
#include <tbb/task_arena.h>
#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <numbers>

#include "dem/cache.h"
#include "dem/error.h"
#include "dem/parallel.h"
#include "engine/camera/pixel_rays.h"
#include "engine/radiometry/radiometry.h"
#include "engine/sensor/sensor.h"
#include "engine/support/pool.h"
#include "engine/support/stopwatch.h"
#include "engine/visibility/frame_sources.h"
#include "engine/visibility/objects_in_frame.h"
#include "engine/visibility/raytrace/trace.h"
#include "engine/visibility/render_pass.h"
#include "engine/visibility/scene.h"
#include "engine/visibility/zbuffer/raster_pass.h"

namespace selenograph::engine {
namespace {

struct SceneKey {
  std::uint64_t low, high;
  bool operator==(const SceneKey&) const = default;
};
struct SceneKeyHash {
  std::size_t operator()(const SceneKey& key) const { return key.low; }
};

SceneKey key_of(const Selection& selection, const Vec3& anchor, Visibility visibility) {
  XXH3_state_t* state = XXH3_createState();
  XXH3_128bits_reset(state);
  XXH3_128bits_update(state, selection.blocks.data(), selection.blocks.size() * sizeof(dem::BlockId));
  XXH3_128bits_update(state, anchor.data(), 3 * sizeof(double));
  XXH3_128bits_update(state, &visibility, sizeof visibility);
  const XXH128_hash_t hash = XXH3_128bits_digest(state);
  XXH3_freeState(state);
  return {hash.low64, hash.high64};
}

// What a lens makes of pixels doesn't depend on where the camera is.
using LensKey = std::array<double, 11>;
LensKey key_of(const Camera& c) {
  const Distortion& d = c.distortion;
  return {static_cast<double>(c.width),
          static_cast<double>(c.height),
          c.fx,
          c.fy,
          c.cx,
          c.cy,
          d.k1,
          d.k2,
          d.k3,
          d.p1,
          d.p2};
}
struct LensKeyHash {
  std::size_t operator()(const LensKey& key) const { return XXH3_64bits(key.data(), sizeof key); }
};

// The tiles that the frame stands on, in the catalogue's order.
void list_sources(const dem::Catalogue& catalogue, const FrameSources& seen, Frame& frame) {
  for (const dem::SourceIndex i : seen.settle(frame.products.source)) {
    const dem::RasterInfo& info = catalogue.rasters()[i];
    const std::string identity = fmt::format("{}:{}:{}", info.name, info.bytes, info.modified_ns);
    frame.report.sources.push_back({info.name, info.path, XXH3_64bits(identity.data(), identity.size())});
  }
}

}  // namespace

struct Renderer::Impl {
  Impl(std::shared_ptr<dem::Terrain> t, const RendererOptions& o)
      : terrain(std::move(t)),
        threads(o.threads > 0 ? o.threads : tbb::this_task_arena::max_concurrency()),
        arena(threads),
        scenes(o.scene_bytes),
        lenses(o.scene_bytes / 8),
        speed_of_rays(threads),
        speed_of_zbuffer(threads) {}

  // The last scene that was made, if it is still in use or in the cache: a moving camera has most of it in common.
  std::shared_ptr<const Scene> latest() const {
    std::lock_guard lock(latest_mutex);
    return latest_scene.lock();
  }

  std::shared_ptr<const Scene> scene(const Selection& selection, const Vec3& anchor, Visibility visibility) {
    return scenes.get(key_of(selection, anchor, visibility), [&] {
      const auto before = latest();
      auto made = std::make_shared<const Scene>(*terrain, selection, anchor, threads, visibility, before.get());
      {
        std::lock_guard lock(latest_mutex);
        latest_scene = made;
      }
      return dem::Cache<SceneKey, Scene, SceneKeyHash>::Loaded{made, made->bytes()};
    });
  }

  void refuse_underground(const FrameRequest& request) const {
    if (request.terrain) refuse_underground(request.pose.position_m);
  }
  void refuse_underground(const Vec3& position) const {
    const double height = position.norm() - kMoonRadius_m;
    if (height > static_cast<double>(dem::kHighestRelief_m)) return;
    const Geographic g = to_geographic(position);
    const dem::HeightAnswer ground = terrain->height(g.lat_deg, g.lon_deg);
    const double lowest = std::isnan(ground.height_m) ? static_cast<double>(dem::kLowestRelief_m) : ground.height_m;
    if (height <= lowest)
      throw ImpossibleRequest(fmt::format(
          "the camera is below the terrain: {:.3f} m above the sphere, ground at {:.3f} m", height, lowest));
  }

  Selection select(const View& view, const FrameRequest& request, const Accuracy& accuracy,
                   const StopToken& stop) const {
    if (!request.terrain) return {};
    const bool light = request.products & (kImage | kRadiance | kLit);
    return select_for_view(*terrain, view, light ? &request.sun : nullptr, accuracy, stop, scenes.capacity(),
                           balls_around(request.objects));
  }

  static Vec3 anchor_of(const View& view) { return anchor_for(view.position(), view.middle()); }

  std::shared_ptr<const PixelRays> lens_of(const Camera& camera) {
    if (camera.distortion.none()) return std::make_shared<const PixelRays>();
    return lenses.get(key_of(camera), [&] {
      auto made = std::make_shared<const PixelRays>(camera, 0, 0);
      return dem::Cache<LensKey, PixelRays, LensKeyHash>::Loaded{made, made->bytes()};
    });
  }

  // Scratch memory and lenses are on the scenes' budget. A frame much larger than the others leaves its scratch memory
  // behind only if that is a small part of it.
  void settle() {
    if (scratch.bytes() > scenes.capacity() / 4) scratch.clear();
    scenes.reserve(scratch.bytes() + lenses.bytes());
  }

  SpeedGauge& speed_of(Visibility visibility) {
    return visibility == Visibility::zbuffer ? speed_of_zbuffer : speed_of_rays;
  }

  BudgetChoice choose(const FrameRequest& request, double budget_ms, int max_samples, const StopToken& stop) {
    const View view(request.camera, request.pose);
    refuse_underground(request);
    Stopwatch watch;
    double spent_ms = 0;
    std::optional<BudgetChoice> best;
    for (const double error_px : kBudgetErrors_px) {
      Accuracy setting{.max_error_px = error_px};
      std::optional<Selection> selection;
      try {
        selection = select(view, request, setting, stop);
      } catch (const TooMuchTerrain&) {
        if (!best) throw;
        break;
      }
      const double select_ms = watch.lap_ms();
      spent_ms += select_ms;
      const Visibility visibility = visibility_for(request, view, *selection);
      const bool build = !scenes.holds(key_of(*selection, anchor_of(view), visibility));
      bool any = false;
      for (const int samples : kBudgetSamples) {
        if (samples > max_samples) break;
        setting.samples_per_pixel = samples;
        // Selected once to choose, once to render.
        const double ms = spent_ms + select_ms +
                          speed_of(visibility).predicted_ms(work_of(request, setting, triangles_of(*selection), build));
        const bool fits = ms <= budget_ms;
        any |= fits;
        if (!best || (fits && expected_error(setting) < expected_error(best->accuracy)))
          best = BudgetChoice{setting, ms, fits};
      }
      if (!any) break;  // finer terrain takes longer still
    }
    return *best;
  }

  Frame render(const FrameRequest& request, const StopToken& stop) {
    if (request.sensor && request.products & kImage) return render_sensed(request, stop);
    Frame frame = render_scene(request, stop);
    Stopwatch watch;
    if (request.products & kImage)
      frame.report.full_scale_radiance_w_m2_sr = expose(request.image, frame.products.radiance, frame.products.image);
    if (!(request.products & kRadiance)) frame.products.radiance = {};
    frame.times.sensor_ms = watch.lap_ms();
    return frame;
  }

  Frame render_sensed(const FrameRequest& request, const StopToken& stop) {
    const Sensor sensor(request);
    FrameRequest wide = request;
    wide.camera = with_margin(request.camera, sensor.margin_px());
    Frame frame = render_scene(wide, stop);
    Stopwatch watch;
    FrameProducts& products = frame.products;
    std::vector<float> light = request.products & kRadiance ? products.radiance : std::move(products.radiance);
    if (!(request.products & kRadiance)) products.radiance.clear();
    if (!request.sensor->motion.none()) light = radiance_in_motion(wide, light, stop, frame.times);
    watch.lap_ms();
    sensor.image(View(wide.camera, wide.pose), *lens_of(wide.camera), std::move(light), products.image);
    crop(products, wide.camera, sensor.margin_px());
    frame.report.full_scale_radiance_w_m2_sr = sensor.full_scale_radiance_w_m2_sr();
    frame.report.margin_px = sensor.margin_px(), frame.report.captured_fraction = sensor.captured();
    frame.times.sensor_ms = watch.lap_ms();
    return frame;
  }

  // The mean over the exposure, whose middle is rendered already; its time counts as visibility.
  std::vector<float> radiance_in_motion(FrameRequest request, const std::vector<float>& in_the_middle,
                                        const StopToken& stop, StageTimes& times) {
    const Motion& motion = request.sensor->motion;
    const Pose middle = request.pose;
    request.products = kRadiance;
    std::vector<float> mean(in_the_middle.size(), 0.F);
    const float share = 1.F / static_cast<float>(motion.samples);
    const auto add = [&](const std::vector<float>& radiance) {
      for (std::size_t i = 0; i < mean.size(); ++i) mean[i] += share * radiance[i];
    };
    for (int k = 0; k < motion.samples; ++k) {
      const double moment = (k + 0.5) / motion.samples - 0.5;
      if (moment == 0) {
        add(in_the_middle);
        continue;
      }
      request.pose = moved(middle, motion, moment * request.sensor->detector.integration_time_s);
      const Frame frame = render_scene(request, stop);
      times.visibility_ms += frame.times.visibility_ms, times.select_ms += frame.times.select_ms;
      times.build_ms += frame.times.build_ms;
      add(frame.products.radiance);
    }
    return mean;
  }

  // All products but the image, and the radiance that it is made from.
  Frame render_scene(const FrameRequest& request, const StopToken& stop) {
    Frame frame;
    Stopwatch watch;
    const View view(request.camera, request.pose);
    refuse_underground(request);
    const ObjectsInFrame objects(request, view);
    const RadianceTerms radiance = radiance_terms(request);
    const Selection selection = select(view, request, request.accuracy, stop);
    frame.times.select_ms = watch.lap_ms();

    const Vec3 anchor = anchor_of(view);
    const Visibility visibility = visibility_for(request, view, selection);
    const bool build = !scenes.holds(key_of(selection, anchor, visibility));
    const auto scene = this->scene(selection, anchor, visibility);
    frame.times.build_ms = watch.lap_ms();

    const auto rays = lens_of(request.camera);
    PassCounts counts;
    FrameSources sources(terrain->catalogue().rasters().size());
    {
      const Pool<FrameScratch>::Lease lease(scratch);
      counts = render_pixels(*scene, view, request, radiance, *rays, objects, sources, stop, *lease, frame.products);
    }
    settle();
    list_sources(terrain->catalogue(), sources, frame);
    frame.times.visibility_ms = watch.lap_ms();
    frame.times.draw_ms = counts.draw_ms, frame.times.resolve_ms = counts.resolve_ms;
    frame.times.shadow_ms = counts.shadow_ms;

    speed_of(visibility).learn(work_of(request, request.accuracy, triangles_of(selection), build), frame.times);
    frame.report.visibility = visibility;
    frame.report.radiance = radiance,
    frame.report.emits_elsewhere = objects.emit() || !request.temperature_maps.empty();
    report(request, selection, *scene, counts, frame.report);
    return frame;
  }

  void report(const FrameRequest& request, const Selection& selection, const Scene& scene, const PassCounts& counts,
              FrameReport& out) const {
    const double pixels = static_cast<double>(request.camera.width) * request.camera.height;
    out.lod_error_px = selection.error_px, out.lod_error_m = selection.error_m;
    out.shadow_error_px = selection.shadow_error_px;
    out.min_post_spacing_m = selection.min_spacing_m, out.max_post_spacing_m = selection.max_spacing_m;
    for (const MeshBlock& b : scene.mesh.blocks())
      out.triangles +=
          2 * static_cast<std::size_t>(b.posts->extent.quads) * static_cast<std::size_t>(b.posts->extent.quads);
    out.scene_bytes = scene.bytes();
    out.hit_fraction = static_cast<double>(counts.hit) / pixels;
    out.object_fraction = static_cast<double>(counts.on_object) / pixels;
    out.missing_fraction = static_cast<double>(counts.missing) / pixels;
    out.filled_fraction = static_cast<double>(counts.filled) / pixels;
    out.warnings = terrain->warnings();
  }

  // Rays against the finest terrain along them.
  std::vector<RayHit> cast(std::span<const Ray> rays, const std::optional<Sun>& sun, const StopToken& stop) {
    std::vector<RayHit> hits(rays.size());
    std::vector<Vec3> facing(rays.size());
    in_batches({rays.begin(), rays.end()}, stop,
               [&](const Scene& scene, const std::vector<std::size_t>& batch, std::size_t first, int count) {
                 Rays packet;
                 for (int i = 0; i < kPacket; ++i) {
                   const Ray& ray = rays[batch[first + static_cast<std::size_t>(std::min(i, count - 1))]];
                   packet.set(i, ray.origin_m, ray.direction.normalized());
                   packet.valid[i] = i < count;
                 }
                 SurfacePoints points;
                 trace(scene, packet, points);
                 for (int i = 0; i < count; ++i) {
                   if (!points.hit[i]) continue;
                   const std::size_t at = batch[first + static_cast<std::size_t>(i)];
                   hits[at] = {true, points.distance[i], points.position(i),
                               shading_normal(scene.mesh, points, i, packet.direction(i)), 0};
                   facing[at] = points.facing(i);
                 }
               });
    if (sun) light(hits, facing, *sun, stop);
    return hits;
  }

  void light(std::vector<RayHit>& hits, const std::vector<Vec3>& facing, const Sun& sun, const StopToken& stop) {
    std::vector<Ray> to_sun;
    std::vector<std::size_t> asked;
    for (std::size_t i = 0; i < hits.size(); ++i)
      if (hits[i].hit && hits[i].normal.dot(sun.direction) > 0)
        to_sun.push_back({hits[i].position_m, sun.direction}), asked.push_back(i);
    in_batches(to_sun, stop,
               [&](const Scene& scene, const std::vector<std::size_t>& batch, std::size_t first, int count) {
                 SurfacePoints points;
                 bool wanted[kPacket] = {};
                 for (int i = 0; i < count; ++i) {
                   const std::size_t at = asked[batch[first + static_cast<std::size_t>(i)]];
                   wanted[i] = true;
                   points.x[i] = hits[at].position_m.x(), points.y[i] = hits[at].position_m.y(),
                   points.z[i] = hits[at].position_m.z();
                   points.nx[i] = facing[at].x(), points.ny[i] = facing[at].y(), points.nz[i] = facing[at].z();
                 }
                 float lit[kPacket];
                 if (sun.angular_radius_deg > 0)
                   sunlit_disc(scene, points, wanted, sun, lit);
                 else
                   sunlit(scene, points, wanted, sun.direction, lit);
                 for (int i = 0; i < count; ++i)
                   hits[asked[batch[first + static_cast<std::size_t>(i)]]].lit = static_cast<double>(lit[i]);
               });
  }

  // Work on packets of rays, as many batches of them as the terrain along them makes scenes of bearable size. Rays that
  // enter the terrain near each other go together.
  template <typename Work>
  void in_batches(const std::vector<Ray>& rays, const StopToken& stop, Work&& work) {
    std::vector<std::pair<dem::BlockId, std::size_t>> places;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const Geographic g = to_geographic(anchor_for(rays[i].origin_m, rays[i].direction));
      places.emplace_back(
          dem::block_at(6, static_cast<std::int32_t>((g.lat_deg + 90) * dem::kTicksPerDegree),
                        dem::wrap_lon(static_cast<std::int64_t>((g.lon_deg + 180) * dem::kTicksPerDegree))),
          i);
    }
    std::sort(places.begin(), places.end());
    std::vector<std::size_t> order;
    order.reserve(places.size());
    for (const auto& place : places) order.push_back(place.second);
    batch(rays, std::move(order), stop, work);
  }

  template <typename Work>
  void batch(const std::vector<Ray>& rays, std::vector<std::size_t> order, const StopToken& stop, Work& work) {
    if (order.empty()) return;
    std::vector<Ray> some;
    some.reserve(order.size());
    for (const std::size_t i : order) some.push_back(rays[i]);
    // A scene in use can't be evicted: one that alone is over the budget is refused before it is built.
    const std::size_t most = std::min(kMaxBlocks, scenes.capacity() / kSceneBytesPerBlock);
    const auto selection = select_for_rays(*terrain, some, order.size() == 1 ? most : most / 4, stop);
    if (!selection && order.size() == 1) throw TooMuchTerrain("a ray runs along more terrain than fits");
    if (!selection) {
      const auto middle = order.begin() + static_cast<std::ptrdiff_t>(order.size() / 2);
      batch(rays, {order.begin(), middle}, stop, work);
      batch(rays, {middle, order.end()}, stop, work);
      return;
    }
    const auto scene = this->scene(*selection, anchor_for(some[0].origin_m, some[0].direction), Visibility::raytrace);
    for_packets(order.size(), stop, [&](std::size_t first, int count) { work(*scene, order, first, count); });
  }

  template <typename Work>
  static void for_packets(std::size_t size, const StopToken& stop, Work&& work) {
    const std::size_t packets = (size + kPacket - 1) / kPacket;
    in_parallel_pieces(packets, 16, [&](std::size_t first, std::size_t past_last) {
      stop.check();
      for (std::size_t p = first; p < past_last; ++p)
        work(p * kPacket, static_cast<int>(std::min<std::size_t>(kPacket, size - p * kPacket)));
    });
  }

  std::vector<Landmark> project(const Camera& camera, const Pose& pose, std::span<const LandmarkQuery> points,
                                const std::optional<Sun>& sun, const StopToken& stop) {
    const View view(camera, pose);
    refuse_underground(view.position());
    std::vector<Landmark> answers(points.size());
    std::vector<Ray> looks, lights;
    std::vector<std::size_t> looked, lighted;
    for (std::size_t i = 0; i < points.size(); ++i) {
      stop.check();
      const LandmarkQuery& q = points[i];
      Landmark& a = answers[i];
      const double ground = terrain->height(q.lat_deg, q.lon_deg).height_m;
      a.height_m = q.height_m.value_or(ground);
      a.x_px = a.y_px = a.range_m = std::nan("");
      if (std::isnan(a.height_m)) continue;
      const Vec3 place = to_cartesian({q.lat_deg, q.lon_deg, a.height_m});
      a.range_m = (place - view.position()).norm();
      const bool buried = a.height_m < ground - 0.01;  // a ray from below passes the surface unseen
      if (sun && !buried) lights.push_back({above(place), sun->direction}), lighted.push_back(i);
      const auto pixel = view.project(place);
      if (!pixel) continue;
      a.x_px = pixel->x, a.y_px = pixel->y;
      a.in_frame =
          pixel->x >= -0.5 && pixel->y >= -0.5 && pixel->x < camera.width - 0.5 && pixel->y < camera.height - 0.5;
      if (a.in_frame) looks.push_back({view.position(), (place - view.position()).normalized()}), looked.push_back(i);
    }
    const std::vector<RayHit> seen = cast(looks, std::nullopt, stop);
    for (std::size_t k = 0; k < seen.size(); ++k) {
      // Visible unless something stands clearly nearer: the landmark itself is met at its own range.
      Landmark& a = answers[looked[k]];
      a.visible = !seen[k].hit || seen[k].range_m > a.range_m - slack_m(a.range_m);
    }
    const std::vector<RayHit> shades = cast(lights, std::nullopt, stop);
    for (std::size_t k = 0; k < shades.size(); ++k) answers[lighted[k]].lit = shades[k].hit ? 0 : 1;
    return answers;
  }

  // A landmark given on the terrain lies on the mesh to within rounding and the chords' sag (2 mm): it is lifted clear
  // of both.
  static Vec3 above(const Vec3& place) { return place * (1 + 0.01 / place.norm()); }
  static double slack_m(double range_m) { return std::max(0.05, 1e-7 * range_m); }

  std::shared_ptr<dem::Terrain> terrain;
  int threads;
  tbb::task_arena arena;
  dem::Cache<SceneKey, Scene, SceneKeyHash> scenes;
  dem::Cache<LensKey, PixelRays, LensKeyHash> lenses;
  Pool<FrameScratch> scratch;
  mutable std::mutex latest_mutex;
  std::weak_ptr<const Scene> latest_scene;
  SpeedGauge speed_of_rays, speed_of_zbuffer;
};

Renderer::Renderer(std::shared_ptr<dem::Terrain> terrain, const RendererOptions& options)
    : impl_(std::make_unique<Impl>(std::move(terrain), options)) {}
Renderer::~Renderer() = default;

Frame Renderer::render(const FrameRequest& request, const StopToken& stop) const {
  return in_arena(impl_->arena, [&] { return impl_->render(request, stop); });
}

BudgetChoice Renderer::choose(const FrameRequest& request, double budget_ms, int max_samples,
                              const StopToken& stop) const {
  return in_arena(impl_->arena, [&] { return impl_->choose(request, budget_ms, max_samples, stop); });
}

std::vector<RayHit> Renderer::cast(std::span<const Ray> rays, const std::optional<Sun>& sun,
                                   const StopToken& stop) const {
  return in_arena(impl_->arena, [&] { return impl_->cast(rays, sun, stop); });
}

std::vector<Landmark> Renderer::project(const Camera& camera, const Pose& pose, std::span<const LandmarkQuery> points,
                                        const std::optional<Sun>& sun, const StopToken& stop) const {
  return in_arena(impl_->arena, [&] { return impl_->project(camera, pose, points, sun, stop); });
}

int Renderer::threads() const { return impl_->threads; }
const dem::Terrain& Renderer::terrain() const { return *impl_->terrain; }
std::size_t Renderer::scene_bytes_in_use() const {
  return impl_->scenes.bytes() + impl_->lenses.bytes() + impl_->scratch.bytes();
}

}  // namespace selenograph::engine
