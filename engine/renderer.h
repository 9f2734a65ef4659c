// The render engine: frames, maps, rays, landmarks.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "dem/detail/rocks_on_ground.h"
#include "dem/support/stop_token.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/budget.h"
#include "engine/frame/frame.h"
#include "engine/frame/map.h"
#include "engine/frame/queries.h"
#include "engine/frame/request.h"
#include "engine/frame/rims.h"
#include "engine/preparation.h"

namespace selenograph::engine {

struct RendererOptions {
  // Worker threads per renderer; 0: all cores. The bytes of an answer don't depend on it.
  int threads = 0;
  // Bytes for what is kept between frames: acceleration structures (least recently used go first), scratch memory and
  // lenses.
  std::size_t scene_bytes = std::size_t{1} << 30;
};

// const means safe to call concurrently.
class Renderer {
 public:
  Renderer(std::shared_ptr<dem::PyramidTerrain> terrain, const RendererOptions& options);
  ~Renderer();

  // Throws ImpossibleRequest when the camera is below the terrain, TooMuchTerrain (one, too), DataError when a
  // needed file is unusable, Cancelled when `stop` says so, TooMuchWork (one, too) when its deadline is out of reach.
  // Same request, same terrain: same bytes.
  Frame render(const FrameRequest& request, const StopToken& stop = {}) const;

  // A map-projected product. `progress`: the share that is done, now and then, by one of the threads at a time. Throws
  // as render does.
  Map map(const MapRequest& request, const StopToken& stop = {},
          const std::function<void(double share)>& progress = {}) const;

  // After a frame: the poses that its camera is expected at next, soonest first; none: it goes on as it did. What they
  // need is made while no frame is in work (preparation.h). Changes no byte of any frame. `name`: of one of several
  // cameras at an instant, which may be alike.
  void expect(const FrameRequest& frame, std::span<const Pose> ahead, std::string_view name = {}) const;
  void wait_until_prepared() const;  // returns when there is nothing left to prepare
  PreparationStatistics preparation_statistics() const;

  // The truest setting for this request (whose own `accuracy` doesn't matter) that is predicted to take no longer than
  // budget_ms on terrain that is in memory, with no more than max_samples per pixel; the coarsest if none. The time
  // spent on choosing counts. Throws as render does.
  BudgetChoice choose(const FrameRequest& request, double budget_ms, int max_samples, const StopToken& stop = {}) const;

  // FrameReport::shadow_limits_px of the frame that render() would make, without making it. Throws as render does.
  std::vector<double> shadow_limits_px(const FrameRequest& request, const StopToken& stop = {}) const;

  // Arbitrary rays against the finest terrain and objects.
  std::vector<RayHit> cast(std::span<const Ray> rays, const std::optional<Sun>& sun, const StopToken& stop = {},
                           const std::vector<SceneObject>& objects = {},
                           const std::shared_ptr<const dem::Detail>& detail = {}) const;

  // Where landmarks appear. in_frame: the pixel coordinates are within [-0.5, width-0.5) x [-0.5, height-0.5) and the
  // point is in front of the camera; visible: in_frame and nothing stands between. With a shutter each is seen by the
  // row that it appears in, in the pose of that row's time (in between, too: y_px is not rounded). Where several do,
  // any of them; where none does, the pixel's coordinates are NaN.
  std::vector<Landmark> project(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                std::span<const LandmarkQuery> points, const std::optional<Sun>& sun,
                                const StopToken& stop = {}, const std::vector<SceneObject>& objects = {},
                                const std::shared_ptr<const dem::Detail>& detail = {}) const;

  // The craters of a detail that the terrain shows in a region (dem/detail/features.h).
  std::vector<dem::CraterFeature> craters(const std::shared_ptr<const dem::Detail>& detail,
                                          const dem::Footprint& region, double smallest_m,
                                          const StopToken& stop = {}) const;
  // The rocks of a detail in a region (dem/detail/rocks_on_ground.h).
  std::vector<dem::RockFeature> rocks(const std::shared_ptr<const dem::Detail>& detail, const dem::Footprint& region,
                                      double smallest_m, const StopToken& stop = {}) const;
  // Craters of a request's detail that its frame sees. Throws as render does.
  CraterRims rims(const FrameRequest& request, const RimOptions& options, const StopToken& stop = {}) const;

  const dem::PyramidTerrain& terrain() const;
  // With detail; null: that of terrain().
  std::shared_ptr<const dem::Terrain> terrain_with(const std::shared_ptr<const dem::Detail>& detail) const;
  int threads() const;              // as many as work on a frame
  std::size_t scene_bytes() const;  // RendererOptions::scene_bytes
  std::size_t scene_bytes_in_use() const;
  // Of the scenes' budget so many bytes are needed elsewhere: that much less is kept from frame to frame.
  void keep_less(std::size_t scene_bytes) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::engine
