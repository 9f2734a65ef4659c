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
#include "dem/map_error/map_detail.h"
#include "dem/map_error/map_error_terrain.h"
#include "engine/cache/preparation.h"
#include "engine/cache/render_cache.h"
#include "engine/cache/render_context.h"
#include "engine/frames/choose_accuracy.h"
#include "engine/frames/frame_forecast.h"
#include "engine/frames/render_frame.h"

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

  // Returns the map of the terrain with a detail. Maps with equal errors share one MapErrorTerrain, and its blocks.
  std::shared_ptr<const dem::Terrain> map_with(const std::shared_ptr<const dem::Detail>& detail,
                                               const dem::MapError& error) {
    const auto is_same = [&](const WrongMap& map) { return map.detail == detail && map.terrain->error() == error; };
    {
      const std::lock_guard lock(details_mutex);
      const auto found = std::find_if(maps.begin(), maps.end(), is_same);
      if (found != maps.end()) {
        std::rotate(maps.begin(), found, found + 1);
        return maps.front().terrain;
      }
    }
    WrongMap made{detail,
                  std::make_shared<const dem::MapErrorTerrain>(terrain_with(dem::detail_of_map(detail, error)), error)};
    const std::lock_guard lock(details_mutex);
    maps.insert(maps.begin(), std::move(made));
    if (maps.size() > kMaxDetails) maps.pop_back();
    return maps.front().terrain;
  }

  // Runs work(context) in the arena, on terrain with that detail, or a map of it. Preparation is paused, or goes on for
  // `frame`.
  template <typename Work>
  auto in_context(const FrameRequest* frame, const std::shared_ptr<const dem::Detail>& detail,
                  const std::optional<dem::MapError>& map_error, const StopToken& stop, const Work& work) {
    const Preparation::Work busy(preparation, frame);
    const auto ground = map_error ? map_with(detail, *map_error) : terrain_with(detail);
    return in_arena(arena, [&] { return work(RenderContext{*ground, cache, stop}); });
  }

  struct WrongMap {
    std::shared_ptr<const dem::Detail> detail;
    std::shared_ptr<const dem::MapErrorTerrain> terrain;
  };

  std::shared_ptr<dem::PyramidTerrain> terrain;
  static constexpr std::size_t kMaxDetails = 16;
  std::mutex details_mutex;
  std::vector<std::shared_ptr<const dem::DetailedTerrain>> details;  // most recently used first
  std::vector<WrongMap> maps;                                        // most recently used first
  int threads;
  tbb::task_arena arena, preparation_arena;
  RenderCache cache;
  Preparation preparation;  // the last member: its thread uses all others
};

Renderer::Renderer(std::shared_ptr<dem::PyramidTerrain> terrain, const RendererOptions& options)
    : impl_(std::make_unique<Impl>(std::move(terrain), options)) {}
Renderer::~Renderer() = default;

Frame Renderer::render(const FrameRequest& request, const StopToken& stop) const {
  return impl_->in_context(&request, request.detail, {}, stop,
                           [&](const RenderContext& context) { return render_frame(request, context); });
}

void Renderer::run(const std::shared_ptr<const dem::Detail>& detail, const std::optional<dem::MapError>& map_error,
                   const StopToken& stop, const std::function<void(const RenderContext& context)>& work) const {
  impl_->in_context(nullptr, detail, map_error, stop, work);
}

BudgetChoice Renderer::choose(const FrameRequest& request, double budget_ms, int max_samples,
                              const StopToken& stop) const {
  return impl_->in_context(&request, request.detail, {}, stop, [&](const RenderContext& context) {
    return choose_accuracy(request, budget_ms, max_samples, context);
  });
}

std::vector<double> Renderer::shadow_limits_px(const FrameRequest& request, const StopToken& stop) const {
  return impl_->in_context(&request, request.detail, {}, stop,
                           [&](const RenderContext& context) { return engine::shadow_limits_px(request, context); });
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
std::shared_ptr<const dem::Terrain> Renderer::terrain_with(const std::shared_ptr<const dem::Detail>& detail,
                                                           const std::optional<dem::MapError>& map_error) const {
  return map_error ? impl_->map_with(detail, *map_error) : impl_->terrain_with(detail);
}
std::size_t Renderer::scene_bytes() const { return impl_->cache.capacity(); }
std::size_t Renderer::scene_bytes_in_use() const { return impl_->cache.bytes(); }

}  // namespace selenograph::engine
