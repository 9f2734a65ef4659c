#include "engine/renderer.h"

#include <tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>
#include <vector>

#include "dem/base/parallel.h"
#include "dem/detail/detailed_terrain.h"
#include "dem/detail/features.h"
#include "engine/cache/preparation.h"
#include "engine/cache/render_cache.h"
#include "engine/frames/choose_accuracy.h"
#include "engine/frames/render_frame.h"
#include "engine/indirect/light_at_places.h"
#include "engine/lidar/lidar_scan.h"
#include "engine/limb/limb_in_view.h"
#include "engine/maps/render_map.h"
#include "engine/rays/ray_queries.h"
#include "engine/sky/sky_in_view.h"

namespace selenograph::engine {

namespace {

// Processor time for preparing all scenes that one frame expects.
constexpr std::chrono::seconds kPreparationBudget{20};

}  // namespace

struct Renderer::Impl {
  Impl(std::shared_ptr<dem::PyramidTerrain> t, const RendererOptions& o)
      : terrain(std::move(t)),
        threads(o.threads > 0 ? o.threads : tbb::this_task_arena::max_concurrency()),
        arena(threads),
        preparation_arena(threads, 1, tbb::task_arena::priority::low),
        cache(terrain, o.scene_bytes, threads),
        preparation(
            [this](const FrameRequest& request, const StopToken& stop) {
              const auto detailed = terrain_with(request.detail);
              return in_arena(preparation_arena, [&] { return prepare_frame(request, {*detailed, cache, stop}); });
            },
            kPreparationBudget / threads) {
    start_threads();
  }

  // Starts all workers now: TBB aborts the process if it cannot create a thread later, when memory is short. Each task
  // spins until all have started, so that each needs a thread of its own.
  void start_threads() {
    using Clock = std::chrono::steady_clock;
    const auto deadline = Clock::now() + std::chrono::milliseconds(200);
    const int thread_count = std::min(threads, tbb::this_task_arena::max_concurrency());
    std::atomic<int> started{0};
    in_arena(arena, [&] {
      in_parallel(static_cast<std::size_t>(thread_count), [&](std::size_t) {
        for (++started; started < thread_count && Clock::now() < deadline;) std::this_thread::yield();
      });
    });
  }

  // Returns the terrain with a detail. Each detail has one DetailedTerrain, whose caches all its requests share.
  std::shared_ptr<const dem::Terrain> terrain_with(const std::shared_ptr<const dem::Detail>& detail) {
    if (!detail) return terrain;
    const std::lock_guard lock(details_mutex);
    const auto found = std::find_if(details.begin(), details.end(),
                                    [&](const auto& detailed) { return &detailed->detail() == detail.get(); });
    if (found != details.end()) {
      std::rotate(details.begin(), found, found + 1);
    } else {
      details.insert(details.begin(), std::make_shared<const dem::DetailedTerrain>(terrain, detail));
      // Drop the least recently used. Requests that use it hold a shared_ptr; a reloaded detail is a new object.
      if (details.size() > kMaxDetails) details.pop_back();
    }
    return details.front();
  }

  // Runs work(terrain with that detail) in the arena, while preparation is paused.
  template <typename Work>
  auto query(const std::shared_ptr<const dem::Detail>& detail, const Work& work) {
    const Preparation::Work busy(preparation, nullptr);
    const auto detailed = terrain_with(detail);
    return in_arena(arena, [&] { return work(*detailed); });
  }

  std::shared_ptr<dem::PyramidTerrain> terrain;
  static constexpr std::size_t kMaxDetails = 16;
  std::mutex details_mutex;
  std::vector<std::shared_ptr<const dem::DetailedTerrain>> details;  // most recently used first
  int threads;
  tbb::task_arena arena, preparation_arena;
  RenderCache cache;
  Preparation preparation;  // the last member: its thread uses all others
};

Renderer::Renderer(std::shared_ptr<dem::PyramidTerrain> terrain, const RendererOptions& options)
    : impl_(std::make_unique<Impl>(std::move(terrain), options)) {}
Renderer::~Renderer() = default;

Frame Renderer::render(const FrameRequest& request, const StopToken& stop) const {
  const Preparation::Work work(impl_->preparation, &request);
  const auto terrain = impl_->terrain_with(request.detail);
  return in_arena(impl_->arena, [&] { return render_frame(request, {*terrain, impl_->cache, stop}); });
}

Map Renderer::map(const MapRequest& request, const StopToken& stop,
                  const std::function<void(double share)>& progress) const {
  const Preparation::Work work(impl_->preparation, nullptr);
  const auto terrain = impl_->terrain_with(request.look.detail);
  return in_arena(impl_->arena, [&] { return render_map(request, *terrain, impl_->cache, stop, progress); });
}

BudgetChoice Renderer::choose(const FrameRequest& request, double budget_ms, int max_samples,
                              const StopToken& stop) const {
  const Preparation::Work work(impl_->preparation, &request);
  const auto terrain = impl_->terrain_with(request.detail);
  return in_arena(impl_->arena, [&] {
    return choose_accuracy(request, budget_ms, max_samples, {*terrain, impl_->cache, stop});
  });
}

std::vector<double> Renderer::shadow_limits_px(const FrameRequest& request, const StopToken& stop) const {
  const Preparation::Work work(impl_->preparation, &request);
  const auto terrain = impl_->terrain_with(request.detail);
  return in_arena(impl_->arena, [&] { return engine::shadow_limits_px(request, {*terrain, impl_->cache, stop}); });
}

std::vector<RayHit> Renderer::cast(std::span<const Ray> rays, const std::optional<Sun>& sun, const StopToken& stop,
                                   const std::vector<SceneObject>& objects,
                                   const std::shared_ptr<const dem::Detail>& detail) const {
  return impl_->query(
      detail, [&](const dem::Terrain& terrain) { return cast_rays(rays, objects, sun, terrain, impl_->cache, stop); });
}

LidarReturns Renderer::lidar(const LidarRequest& request, const StopToken& stop) const {
  return impl_->query(request.scenery.detail,
                      [&](const dem::Terrain& terrain) { return scan_lidar(request, terrain, impl_->cache, stop); });
}

std::vector<Irradiance> Renderer::light_at(std::span<const LitPlace> places, const FrameRequest& request,
                                           const StopToken& stop) const {
  return impl_->query(request.detail, [&](const dem::Terrain& terrain) {
    return light_at_places(places, request, terrain, impl_->cache.light_tiles(), stop);
  });
}

std::vector<Landmark> Renderer::project(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                        std::span<const LandmarkQuery> points, const std::optional<Sun>& sun,
                                        const StopToken& stop, const std::vector<SceneObject>& objects,
                                        const std::shared_ptr<const dem::Detail>& detail) const {
  return impl_->query(detail, [&](const dem::Terrain& terrain) {
    return project_landmarks(camera, pose, shutter, points, objects, sun, terrain, impl_->cache, stop);
  });
}

std::vector<SkyObject> Renderer::sky(const FrameRequest& request, const StopToken& stop) const {
  return impl_->query(request.detail,
                      [&](const dem::Terrain& terrain) { return query_sky(request, terrain, impl_->cache, stop); });
}

std::vector<LimbPoint> Renderer::limb(const LimbRequest& request, const StopToken& stop,
                                      const std::shared_ptr<const dem::Detail>& detail) const {
  return impl_->query(detail, [&](const dem::Terrain& terrain) { return find_limb(request, terrain, stop); });
}

std::vector<TerminatorPoint> Renderer::terminator(const LimbRequest& request, const StopToken& stop,
                                                  const std::shared_ptr<const dem::Detail>& detail) const {
  return impl_->query(
      detail, [&](const dem::Terrain& terrain) { return find_terminator(request, terrain, impl_->cache, stop); });
}

std::vector<dem::CraterFeature> Renderer::craters(const std::shared_ptr<const dem::Detail>& detail,
                                                  const dem::Footprint& region, double smallest_m, double least_depth,
                                                  const StopToken& stop) const {
  return impl_->query(detail, [&](const dem::Terrain& terrain) {
    const dem::CraterSurvey survey(terrain, impl_->cache.roughness(terrain, stop));
    return survey.craters_in(region, smallest_m, least_depth, stop);
  });
}

std::vector<dem::RockFeature> Renderer::rocks(const std::shared_ptr<const dem::Detail>& detail,
                                              const dem::Footprint& region, double smallest_m,
                                              const StopToken& stop) const {
  return impl_->query(
      detail, [&](const dem::Terrain& terrain) { return dem::RockSurvey(terrain).rocks_in(region, smallest_m, stop); });
}

void Renderer::expect(const FrameRequest& frame, std::span<const Pose> ahead, std::string_view name) const {
  // A frame with one pose per row has no single pose from which the next could be extrapolated.
  if (frame.terrain && !(frame.shutter && !frame.shutter->poses.empty())) impl_->preparation.expect(frame, ahead, name);
}

std::shared_ptr<const void> Renderer::pause_preparation() const {
  return std::make_shared<const Preparation::Work>(impl_->preparation);
}

PreparationStatistics Renderer::preparation_statistics() const { return impl_->cache.preparation_statistics(); }

int Renderer::threads() const { return impl_->threads; }
const dem::PyramidTerrain& Renderer::terrain() const { return *impl_->terrain; }
std::shared_ptr<const dem::Terrain> Renderer::terrain_with(const std::shared_ptr<const dem::Detail>& detail) const {
  return impl_->terrain_with(detail);
}
std::size_t Renderer::scene_bytes() const { return impl_->cache.capacity(); }
std::size_t Renderer::scene_bytes_in_use() const { return impl_->cache.bytes(); }
void Renderer::keep_less(std::size_t scene_bytes) const { impl_->cache.keep_less(scene_bytes); }

}  // namespace selenograph::engine
