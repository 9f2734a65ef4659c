// The render engine's one door: frames, and all other capabilities through query().
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/detail.h"
#include "dem/map_error/map_error.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/cache/budget.h"
#include "engine/cache/preparation.h"
#include "engine/frame/frame.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

struct RenderContext;

struct RendererOptions {
  // Worker threads per renderer; 0: all cores. Answers do not depend on it.
  int threads = 0;
  // Memory budget for data kept between frames, in bytes: acceleration structures (least recently used evicted first),
  // scratch memory and lenses.
  std::size_t scene_bytes = std::size_t{1} << 30;
};

// Thread-safe: const functions may be called concurrently.
class Renderer {
 public:
  Renderer(std::shared_ptr<dem::PyramidTerrain> terrain, const RendererOptions& options);
  ~Renderer();

  // Renders a frame. Throws ImpossibleRequest when the camera is below the terrain; TooMuchTerrain (an
  // ImpossibleRequest); DataError when a needed file is unusable; Cancelled when `stop` says so; TooMuchWork (a
  // Cancelled) when its deadline is out of reach. The same request on the same terrain gives the same bytes.
  Frame render(const FrameRequest& request, const StopToken& stop = {}) const;

  // Returns work(context), for a capability's entry function, which takes a RenderContext as its last argument:
  //
  //   renderer.query(detail, stop, [&](const RenderContext& context) { return find_limb(request, context); });
  //
  // The context's terrain has the detail (null: the plain terrain). The work runs in the task arena of this renderer,
  // while no preparation runs. Throws what the work throws.
  template <typename Work>
  auto query(const std::shared_ptr<const dem::Detail>& detail, const StopToken& stop, const Work& work) const {
    return query(detail, std::nullopt, stop, work);
  }
  // The same on a map of the terrain with errors; without an error, on the terrain.
  template <typename Work>
  auto query(const std::shared_ptr<const dem::Detail>& detail, const std::optional<dem::MapError>& map_error,
             const StopToken& stop, const Work& work) const {
    std::optional<std::invoke_result_t<const Work&, const RenderContext&>> result;
    run(detail, map_error, stop, [&](const RenderContext& context) { result.emplace(work(context)); });
    return *std::move(result);
  }

  // Prepares the scenes of the frames expected after `frame`, while no request is rendered (preparation.h). `ahead`:
  // the poses of its camera's next frames, soonest first. Takes at most 20 s of processor time and half of the scenes'
  // memory, and changes no byte of any frame. `name` distinguishes identical cameras at one instant.
  void expect(const FrameRequest& frame, std::span<const Pose> ahead, std::string_view name = {}) const;
  // While the returned object exists, no preparation begins.
  std::shared_ptr<const void> pause_preparation() const;
  PreparationStatistics preparation_statistics() const;

  // Returns the most accurate setting for this request (whose own `accuracy` is ignored) that is predicted to take no
  // longer than budget_ms on terrain in memory, with at most max_samples per pixel; the coarsest if none fits. The time
  // spent on choosing counts. Throws as render does.
  BudgetChoice choose(const FrameRequest& request, double budget_ms, int max_samples, const StopToken& stop = {}) const;

  // Returns FrameReport::shadow_limits_px of the frame that render() would make, without making it. Throws as render
  // does.
  std::vector<double> shadow_limits_px(const FrameRequest& request, const StopToken& stop = {}) const;

  const dem::PyramidTerrain& terrain() const;
  // Returns the terrain with a detail, or a map of it with errors; for null and no error, terrain() itself.
  std::shared_ptr<const dem::Terrain> terrain_with(const std::shared_ptr<const dem::Detail>& detail,
                                                   const std::optional<dem::MapError>& map_error = {}) const;
  int threads() const;              // number of threads that work on a frame
  std::size_t scene_bytes() const;  // RendererOptions::scene_bytes
  std::size_t scene_bytes_in_use() const;

 private:
  struct Impl;
  void run(const std::shared_ptr<const dem::Detail>& detail, const std::optional<dem::MapError>& map_error,
           const StopToken& stop, const std::function<void(const RenderContext& context)>& work) const;

  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::engine
