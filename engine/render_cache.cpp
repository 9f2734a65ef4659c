#include "engine/render_cache.h"

#include <xxhash.h>

#include <chrono>
#include <thread>
#include <type_traits>

#include "engine/scene/selection.h"

namespace selenograph::engine {

// The structured bindings name every member: one more, and they don't compile until it is part of the key.

RenderCache::SceneKey RenderCache::key_of(const SceneContent& content) {
  const auto& [blocks, anchor_m, visibility] = content;
  static_assert(std::has_unique_object_representations_v<dem::BlockId>);
  XXH3_state_t* state = XXH3_createState();
  XXH3_128bits_reset(state);
  XXH3_128bits_update(state, blocks.data(), blocks.size() * sizeof(dem::BlockId));
  XXH3_128bits_update(state, anchor_m.data(), 3 * sizeof(double));
  XXH3_128bits_update(state, &visibility, sizeof visibility);
  const XXH128_hash_t hash = XXH3_128bits_digest(state);
  XXH3_freeState(state);
  return {hash.low64, hash.high64};
}

std::size_t RenderCache::CameraHash::operator()(const Camera& c) const {
  const std::array numbers{static_cast<double>(c.width), static_cast<double>(c.height), c.fx, c.fy, c.cx, c.cy};
  return XXH3_64bits(numbers.data(), sizeof numbers);
}

RenderCache::RenderCache(std::shared_ptr<const dem::Terrain> terrain, std::size_t bytes, int threads)
    : terrain_(std::move(terrain)),
      threads_(threads),
      scenes_(bytes),
      lenses_(bytes / 8),
      speed_of_rays_(threads),
      speed_of_zbuffer_(threads) {}

// Room for a scene while it is made. The first is let in whatever its size: selection has bounded it.
class RenderCache::Room {
 public:
  Room(RenderCache& cache, const SceneContent& content, const StopToken& stop) : cache_(cache) {
    for (const dem::BlockId& id : content.blocks) bytes_ += scene_bytes_of(id);
    while (!enter()) {
      stop.check();
      std::this_thread::sleep_for(kLook);
    }
  }
  ~Room() {
    const std::lock_guard lock(cache_.room_mutex_);
    cache_.being_made_bytes_ -= bytes_;
  }
  Room(const Room&) = delete;
  Room& operator=(const Room&) = delete;

 private:
  static constexpr auto kLook = std::chrono::milliseconds(2);

  bool enter() {
    const std::lock_guard lock(cache_.room_mutex_);
    const std::size_t taken = cache_.being_made_bytes_ + cache_.scenes_.bytes_in_use();
    if (taken > 0 && taken + bytes_ > cache_.scenes_.capacity()) return false;
    cache_.being_made_bytes_ += bytes_;
    return true;
  }

  RenderCache& cache_;
  std::size_t bytes_ = 0;
};

std::shared_ptr<const Scene> RenderCache::scene(const SceneContent& content, const StopToken& stop) {
  const auto make = [&] {
    const Room room(*this, content, stop);
    std::shared_ptr<const Scene> before;
    {
      const std::lock_guard lock(latest_mutex_);
      before = latest_.lock();
    }
    auto made = std::make_shared<const Scene>(*terrain_, content, threads_, before.get(), stop);
    {
      const std::lock_guard lock(latest_mutex_);
      latest_ = made;
    }
    return dem::Cache<SceneKey, Scene, SceneKeyHash>::Loaded{made, made->bytes()};
  };
  return scenes_.get(key_of(content), make, stop);
}

bool RenderCache::holds(const SceneContent& content) const { return scenes_.holds(key_of(content)); }

void RenderCache::forget(const SceneContent& content) {
  scenes_.erase(key_of(content));
  const std::lock_guard lock(latest_mutex_);
  latest_.reset();
}

std::shared_ptr<const PixelRays> RenderCache::lens(const Camera& camera, const StopToken& stop) {
  if (camera.rectilinear()) return std::make_shared<const PixelRays>();
  return lenses_.get(
      camera,
      [&] {
        auto made = std::make_shared<const PixelRays>(camera, 0, 0, stop);
        return dem::Cache<Camera, PixelRays, CameraHash>::Loaded{made, made->bytes()};
      },
      stop);
}

void RenderCache::settle() {
  if (scratch_.bytes() > scenes_.capacity() / 4) scratch_.clear();
  scenes_.reserve(scratch_.bytes() + lenses_.bytes());
}

}  // namespace selenograph::engine
