// The render engine: frames, maps, rays, landmarks.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/rocks_on_ground.h"
#include "dem/terrain/pyramid_terrain.h"
#include "engine/cache/budget.h"
#include "engine/cache/preparation.h"
#include "engine/frame/frame.h"
#include "engine/frame/lidar.h"
#include "engine/frame/limb.h"
#include "engine/frame/map.h"
#include "engine/frame/queries.h"
#include "engine/frame/request.h"

namespace selenograph::engine {

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

  // Renders a map-projected product. `progress` receives the finished share from time to time, from one thread at a
  // time. Throws as render does.
  Map map(const MapRequest& request, const StopToken& stop = {},
          const std::function<void(double share)>& progress = {}) const;

  // Prepares the scenes of the frames expected after `frame`, while no request is rendered (preparation.h). `ahead`:
  // the poses of its camera's next frames, soonest first; empty: its motion is extrapolated. Takes at most 20 s of
  // processor time and half of the scenes' memory, and changes no byte of any frame. `name` distinguishes identical
  // cameras at one instant.
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

  // Intersects arbitrary rays with the finest terrain and objects.
  std::vector<RayHit> cast(std::span<const Ray> rays, const std::optional<Sun>& sun, const StopToken& stop = {},
                           const std::vector<SceneObject>& objects = {},
                           const std::shared_ptr<const dem::Detail>& detail = {}) const;

  // Scans with a lidar (engine/lidar/lidar_scan.h).
  LidarReturns lidar(const LidarRequest& request, const StopToken& stop = {}) const;

  // Returns the light at places, as in a frame of that request (engine/indirect/light_at_places.h): its Sun, ground,
  // band, detail and indirect light are used.
  std::vector<Irradiance> light_at(std::span<const LitPlace> places, const FrameRequest& request,
                                   const StopToken& stop = {}) const;

  // Projects landmarks. in_frame: the pixel coordinates are within [-0.5, width-0.5) x [-0.5, height-0.5) and the point
  // is in front of the camera; visible: in_frame and nothing stands between. With a shutter a landmark appears in the
  // row that sees it, in the pose of that row's time (interpolated between rows: y_px is not rounded). If several rows
  // see it, any of them is returned; if none does, the pixel coordinates are NaN.
  std::vector<Landmark> project(const Camera& camera, const Pose& pose, const std::optional<Shutter>& shutter,
                                std::span<const LandmarkQuery> points, const std::optional<Sun>& sun,
                                const StopToken& stop = {}, const std::vector<SceneObject>& objects = {},
                                const std::shared_ptr<const dem::Detail>& detail = {}) const;

  // Returns stars, the Sun, the Earth and planets of request.sky in the image of its camera, with their occluders
  // (engine/sky/sky_in_view.h). Reads the request's camera, pose, shutter, band, objects, detail, terrain, sensor and
  // sky. Throws ImpossibleRequest for too many stars, and as render does.
  std::vector<SkyObject> sky(const FrameRequest& request, const StopToken& stop = {}) const;

  // Returns the limb of the finest terrain, without rocks, and that of the sphere, in order of azimuth. A point has no
  // terrain if its line of sight passes ground without data below the height of the highest terrain. Throws as render
  // does.
  std::vector<LimbPoint> limb(const LimbRequest& request, const StopToken& stop = {},
                              const std::shared_ptr<const dem::Detail>& detail = {}) const;
  // Returns the terminator of the request's Sun, in order of azimuth; empty without a Sun. Throws as limb() does.
  std::vector<TerminatorPoint> terminator(const LimbRequest& request, const StopToken& stop = {},
                                          const std::shared_ptr<const dem::Detail>& detail = {}) const;

  // Returns the craters of a detail that the terrain shows in a region, at least `least_depth` of their diameter deep
  // (dem/detail/features.h). FrameRequest::craters asks for the craters of a frame.
  std::vector<dem::CraterFeature> craters(const std::shared_ptr<const dem::Detail>& detail,
                                          const dem::Footprint& region, double smallest_m, double least_depth,
                                          const StopToken& stop = {}) const;
  // Returns the rocks of a detail in a region (dem/detail/rocks_on_ground.h).
  std::vector<dem::RockFeature> rocks(const std::shared_ptr<const dem::Detail>& detail, const dem::Footprint& region,
                                      double smallest_m, const StopToken& stop = {}) const;

  const dem::PyramidTerrain& terrain() const;
  // Returns the terrain with a detail; for null, terrain() itself.
  std::shared_ptr<const dem::Terrain> terrain_with(const std::shared_ptr<const dem::Detail>& detail) const;
  int threads() const;              // number of threads that work on a frame
  std::size_t scene_bytes() const;  // RendererOptions::scene_bytes
  std::size_t scene_bytes_in_use() const;
  // Reduces the scenes' budget by memory that is needed elsewhere (RenderCache::keep_less).
  void keep_less(std::size_t scene_bytes) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace selenograph::engine
