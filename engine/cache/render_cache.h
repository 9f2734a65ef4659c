// Data kept from frame to frame, on one memory budget: scenes, lenses, stray light, rocks, scratch memory; and the
// measured speed of frames.
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <mutex>
#include <unordered_set>

#include "dem/base/cache.h"
#include "dem/base/pool.h"
#include "dem/base/stop_token.h"
#include "dem/detail/crater_visibility.h"
#include "dem/detail/rocks_on_ground.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/budget.h"
#include "engine/cache/preparation.h"
#include "engine/camera/pixel_rays.h"
#include "engine/indirect/light_tile.h"
#include "engine/sensor/stray_light.h"
#include "engine/support/content_key.h"
#include "engine/visibility/points/scene.h"
#include "engine/visibility/zbuffer/raster_pass.h"

namespace selenograph::engine {

// Thread-safe.
class RenderCache {
 public:
  // `threads`: number of threads that work on a frame.
  RenderCache(std::shared_ptr<const dem::Terrain> terrain, std::size_t bytes, int threads);

  // Purpose of a scene: a requested frame, or one that is expected.
  enum class Purpose { frame, preparation };

  // Returns a scene, building it if it is not cached. Concurrent requests for the same scene build it once; the others
  // wait, each until its own `stop`, and then Cancelled is thrown. Scenes in use cannot be evicted: a scene that does
  // not fit beside them waits until they are released. The caller must hold no scene: two callers that each hold one
  // and wait for the other's memory would deadlock.
  std::shared_ptr<const Scene> scene(const SceneContent& content, const StopToken& stop = {},
                                     Purpose purpose = Purpose::frame);
  bool holds(const SceneContent& content) const;
  // Returns a function that returns whether the scene is still cached and marks it as used. This object must outlive
  // the function.
  std::function<bool()> use_of(const SceneContent& content);
  // Removes a scene from the cache, for maps, whose scenes are not used again.
  void forget(const SceneContent& content);

  PreparationStatistics preparation_statistics();

  // Returns the directions of the camera's pixels; empty without distortion. Throws Cancelled when stopped.
  std::shared_ptr<const PixelRays> lens(const Camera& camera, const StopToken& stop);

  // Returns the stray light of the optics over the camera's image. Throws Cancelled when stopped.
  std::shared_ptr<const ScatteredLight> scattered(const StrayLight& law, const Camera& camera, const StopToken& stop);

  // Returns the roughness of a terrain's detail, which the terrain must have. It is measured once per detail.
  std::shared_ptr<const dem::CraterRoughness> roughness(const dem::Terrain& terrain, const StopToken& stop);
  // Rocks of details and their surroundings: on the budget, at most an eighth of it.
  const std::shared_ptr<dem::RockMemory>& rocks() const { return rocks_; }

  // Indirect light of terrain, on the budget: at most half of it.
  LightTiles& light_tiles() { return light_tiles_; }

  // Keep leases short: leased memory does not count towards the budget.
  Pool<FrameScratch>& scratch() { return scratch_; }
  // Call after a lease has ended. Scratch memory, lenses, stray light and rocks count towards the scenes' budget. A
  // frame much larger than the others leaves its scratch memory behind only if that is a small part of the budget.
  void settle();

  SpeedGauge& speed(Visibility visibility) {
    return visibility == Visibility::zbuffer ? speed_of_zbuffer_ : speed_of_rays_;
  }

  std::size_t capacity() const { return scenes_.capacity(); }
  std::size_t bytes() const { return scenes_.bytes() + other_bytes(); }

 private:
  // Hashes the members in which most cameras differ; equality compares all members.
  struct CameraHash {
    std::size_t operator()(const Camera& camera) const;
  };
  static ContentKey key_of(const SceneContent& content);
  class SceneReservation;
  // Updates the bytes of the budget that finished scenes may not use.
  void reserve();
  // Bytes of everything but scenes.
  std::size_t other_bytes() const {
    return lenses_.bytes() + scattered_.bytes() + rocks_->bytes() + light_tiles_.bytes() + scratch_.bytes();
  }
  std::size_t latest_scene_bytes();
  bool fits_for_preparation(std::size_t bytes);
  // Returns the recent scene that shares the most with a content, or null.
  std::shared_ptr<const Scene> find_most_similar(const SceneContent& content);

  std::shared_ptr<const dem::Terrain> terrain_;
  int threads_;
  dem::Cache<ContentKey, Scene, ContentKeyHash> scenes_;
  dem::Cache<Camera, PixelRays, CameraHash> lenses_;  // pixel directions do not depend on the pose
  dem::Cache<ContentKey, ScatteredLight, ContentKeyHash> scattered_;
  static constexpr std::size_t kMaxRoughnesses = 16;
  dem::Cache<int, dem::CraterRoughness> roughnesses_{kMaxRoughnesses};  // by the detail's number
  std::shared_ptr<dem::RockMemory> rocks_;
  LightTiles light_tiles_;
  Pool<FrameScratch> scratch_;
  std::mutex reservation_mutex_;
  std::size_t reserved_bytes_ = 0;  // by scenes that are being built
  // The most recent scenes, drawn or prepared, newest first, if still in use or cached: a moving camera's next scene
  // shares most blocks with one of them.
  static constexpr std::size_t kLatestScenes = 4;
  std::mutex scenes_mutex_;
  std::deque<std::weak_ptr<const Scene>> latest_scenes_;
  std::unordered_set<ContentKey, ContentKeyHash> prepared_;  // scenes that no frame has used yet
  PreparationStatistics statistics_;
  SpeedGauge speed_of_rays_, speed_of_zbuffer_;
  std::size_t prepared_bytes_ = 0;  // of scenes prepared since the latest frame
};

}  // namespace selenograph::engine
