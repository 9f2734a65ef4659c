// What is kept from frame to frame, on one budget in bytes: scenes, lenses, scratch memory; and how fast frames have
// been.
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

#include "dem/support/cache.h"
#include "dem/support/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/budget.h"
#include "engine/camera/pixel_rays.h"
#include "engine/preparation.h"
#include "engine/support/pool.h"
#include "engine/visibility/points/scene.h"
#include "engine/visibility/zbuffer/raster_pass.h"

namespace selenograph::engine {

// Safe to use concurrently.
class RenderCache {
 public:
  // `threads`: that work on a frame.
  RenderCache(std::shared_ptr<const dem::Terrain> terrain, std::size_t bytes, int threads);

  // What a scene is made for: a frame that is asked for, or one that may be.
  enum class Purpose { frame, preparation };

  // Of several who need the same scene one makes it; each waits until its own `stop`, then Cancelled is thrown. Scenes
  // in use can't be evicted: one that doesn't fit beside them waits for them to be let go, so the caller must hold
  // none.
  std::shared_ptr<const Scene> scene(const SceneContent& content, const StopToken& stop = {},
                                     Purpose purpose = Purpose::frame);
  bool holds(const SceneContent& content) const;
  // Which says whether the scene is still kept, and counts as a use of it; for as long as this lives.
  std::function<bool()> use_of(const SceneContent& content);
  void forget(const SceneContent& content);

  PreparationStatistics preparation_statistics();

  // Where the camera's pixels look; empty without distortion. Throws Cancelled when `stop` says so.
  std::shared_ptr<const PixelRays> lens(const Camera& camera, const StopToken& stop);

  // Leases are to be short: what is lent is not on the budget.
  Pool<FrameScratch>& scratch() { return scratch_; }
  // After a lease has ended. Scratch memory and lenses are on the scenes' budget. A frame much larger than the others
  // leaves its scratch memory behind only if that is a small part of it.
  void settle();

  // Of the budget so many bytes are needed elsewhere: so much less is kept, but for the latest scene. What a frame may
  // take stays the same.
  void keep_less(std::size_t bytes);

  SpeedGauge& speed(Visibility visibility) {
    return visibility == Visibility::zbuffer ? speed_of_zbuffer_ : speed_of_rays_;
  }

  std::size_t capacity() const { return scenes_.capacity(); }
  std::size_t bytes() const { return scenes_.bytes() + lenses_.bytes() + scratch_.bytes(); }

 private:
  struct SceneKey {
    std::uint64_t low, high;
    bool operator==(const SceneKey&) const = default;
  };
  struct SceneKeyHash {
    std::size_t operator()(const SceneKey& key) const { return key.low; }
  };
  // Of what most cameras differ in; whether they are the same is decided by all members.
  struct CameraHash {
    std::size_t operator()(const Camera& camera) const;
  };
  static SceneKey key_of(const SceneContent& content);
  class Room;
  void reserve();
  std::size_t latest_scene_bytes();
  class PartsOnce;
  std::shared_ptr<const Scene> most_in_common(const SceneContent& content);

  std::shared_ptr<const dem::Terrain> terrain_;
  int threads_;
  dem::Cache<SceneKey, Scene, SceneKeyHash> scenes_;
  dem::Cache<Camera, PixelRays, CameraHash> lenses_;  // where pixels look doesn't depend on the pose
  Pool<FrameScratch> scratch_;
  std::mutex room_mutex_;
  std::size_t being_made_bytes_ = 0;  // of scenes
  std::atomic<std::size_t> less_{0};
  // The scenes that were made last, if still in use or kept: a moving camera has most of one in common. First the
  // latest.
  static constexpr std::size_t kLatest = 4;
  std::mutex latest_mutex_;
  std::deque<std::weak_ptr<const Scene>> latest_;
  std::unordered_set<SceneKey, SceneKeyHash> prepared_;  // that no frame has had yet
  PreparationStatistics statistics_;
  SpeedGauge speed_of_rays_, speed_of_zbuffer_;
};

}  // namespace selenograph::engine
