#include "engine/cache/render_cache.h"

#include <algorithm>
#include <chrono>
#include <limits>
#include <new>
#include <thread>
#include <unordered_map>
#include <utility>
#include <vector>

#include "dem/base/hash.h"
#include "dem/detail/detailed_terrain.h"
#include "engine/scene/selection.h"

namespace selenograph::engine {

namespace {

// More than one frame may have. Rocks farther away than the next frames are not worth their memory.
constexpr std::size_t kMaxRockBytes = std::size_t{16} << 20;

int detail_of(const SceneContent& content) { return content.terrain ? content.terrain->detail_number() : 0; }

}  // namespace

// Returns the key of a scene. The structured binding names every member, so that a new member breaks the build until it
// is part of the key.
ContentKey RenderCache::key_of(const SceneContent& content) {
  const auto& [blocks, anchor_m, visibility, terrain, soft_corners] = content;
  const int detail = detail_of(content);
  ContentHash hash;
  hash.add(blocks.data(), blocks.size());
  hash.add(soft_corners.data(), soft_corners.size());
  hash.add(anchor_m);
  hash.add(visibility);
  hash.add(detail);
  return hash.key();
}

std::size_t RenderCache::CameraHash::operator()(const Camera& c) const {
  const std::array numbers{static_cast<double>(c.width), static_cast<double>(c.height), c.fx, c.fy, c.cx, c.cy};
  return dem::hash_of(numbers.data(), sizeof numbers);
}

namespace {

// Counts the bytes of scenes that share parts: a part counts once, with its first scene, and is freed with its last.
class SharedPartCounter {
 public:
  // Adds a scene's parts. Returns the bytes that this adds.
  std::size_t add(const Scene& scene) {
    std::size_t sum = scene.own_bytes(), counted = 0;
    try {
      scene.for_each_part([&](const void* part, std::size_t bytes) {
        if (++users_[part] == 1) sum += bytes;  // may throw; `counted` then tells what to undo
        ++counted;
      });
    } catch (const std::bad_alloc&) {
      remove_first(scene, counted);
      throw;
    }
    return sum;
  }
  // Removes a scene's parts. Returns the bytes that this frees.
  std::size_t remove(const Scene& scene) {
    return scene.own_bytes() + remove_first(scene, std::numeric_limits<std::size_t>::max());
  }

 private:
  // Removes the first `count` parts of a scene. Returns the bytes that this frees.
  std::size_t remove_first(const Scene& scene, std::size_t count) {
    std::size_t sum = 0;
    scene.for_each_part([&](const void* part, std::size_t bytes) {
      if (count == 0) return;
      --count;
      const auto found = users_.find(part);
      if (found == users_.end() || --found->second > 0) return;
      users_.erase(found);
      sum += bytes;
    });
    return sum;
  }

  std::unordered_map<const void*, int> users_;
};

dem::Cache<ContentKey, Scene, ContentKeyHash>::Count count_shared_parts_once() {
  const auto parts = std::make_shared<SharedPartCounter>();
  return {[parts](const Scene& scene) { return parts->add(scene); },
          [parts](const Scene& scene) { return parts->remove(scene); }};
}

}  // namespace

RenderCache::RenderCache(std::shared_ptr<const dem::Terrain> terrain, std::size_t bytes, int threads)
    : terrain_(std::move(terrain)),
      threads_(threads),
      scenes_(bytes, count_shared_parts_once()),
      lenses_(bytes / 8),
      scattered_(bytes / 8),
      rocks_(std::make_shared<dem::RockMemory>(std::min(bytes / 8, kMaxRockBytes))),
      light_tiles_(bytes / 2),
      speed_of_rays_(threads),
      speed_of_zbuffer_(threads) {}

// A reservation of memory for a scene while it is built, for those of its blocks that it does not share with a recent
// scene. The constructor waits until the reserved bytes and the scenes in use leave enough of the budget. Scenes not in
// use do not count: reserve() evicts them. If nothing is reserved or in use, a scene of any size is admitted: selection
// has bounded it. In preparation a scene must fit beside the latest scene, whose frame sequence continues; otherwise
// the constructor throws Cancelled.
class RenderCache::SceneReservation {
 public:
  SceneReservation(RenderCache& cache, const SceneContent& content, Purpose purpose, const StopToken& stop)
      : cache_(cache) {
    {
      // Release this scene before waiting: a scene held here would count as in use and keep other waiters waiting.
      const std::shared_ptr<const Scene> similar = cache.find_most_similar(content);
      const bool same_anchor = similar && similar->anchor == content.anchor_m;
      for (const dem::BlockId& id : content.blocks)
        if (!(same_anchor && similar->mesh.holds(id))) bytes_ += scene_bytes_of(id, content.visibility);
    }
    if (purpose == Purpose::preparation && !cache.fits_for_preparation(bytes_)) throw Cancelled();
    // Poll: a scene in use is released by whoever drops its last shared_ptr, and nothing is notified of that.
    while (!try_reserve()) {
      stop.check();
      std::this_thread::sleep_for(kPollInterval);
    }
  }
  ~SceneReservation() {
    const std::lock_guard lock(cache_.reservation_mutex_);
    cache_.reserved_bytes_ -= bytes_;
  }
  SceneReservation(const SceneReservation&) = delete;
  SceneReservation& operator=(const SceneReservation&) = delete;
  std::size_t bytes() const { return bytes_; }

 private:
  static constexpr auto kPollInterval = std::chrono::milliseconds(2);

  // Returns false if the memory is not available yet.
  bool try_reserve() {
    const std::lock_guard lock(cache_.reservation_mutex_);
    const std::size_t pinned_bytes = cache_.reserved_bytes_ + cache_.scenes_.bytes_in_use();
    if (pinned_bytes > 0 && pinned_bytes + bytes_ > cache_.scenes_.capacity()) return false;
    cache_.reserved_bytes_ += bytes_;
    return true;
  }

  RenderCache& cache_;
  std::size_t bytes_ = 0;
};

std::shared_ptr<const Scene> RenderCache::find_most_similar(const SceneContent& content) {
  std::vector<std::shared_ptr<const Scene>> candidates;
  {
    const std::lock_guard lock(scenes_mutex_);
    for (const auto& weak_scene : latest_scenes_)
      if (auto scene = weak_scene.lock()) candidates.push_back(std::move(scene));
  }
  std::shared_ptr<const Scene> best;
  std::size_t best_score = 0;
  for (auto& scene : candidates) {
    if (scene->detail != detail_of(content)) continue;
    std::size_t score = 0;
    for (const dem::BlockId& id : content.blocks) score += scene->mesh.holds(id);
    if (scene->anchor == content.anchor_m) score *= 2;  // with another anchor, float coordinates are recomputed
    if (score > best_score) {
      best_score = score;
      best = std::move(scene);
    }
  }
  return best;
}

std::shared_ptr<const Scene> RenderCache::scene(const SceneContent& content, const StopToken& stop, Purpose purpose) {
  const ContentKey key = key_of(content);
  const auto make = [&] {
    const SceneReservation reservation(*this, content, purpose, stop);
    SceneParts before;
    if (const auto scene = find_most_similar(content)) before = scene->parts_for(content.anchor_m);
    reserve();
    auto made =
        std::make_shared<const Scene>(content.terrain ? *content.terrain : *terrain_, content, threads_, before, stop);
    const std::lock_guard lock(scenes_mutex_);
    latest_scenes_.push_front(made);
    if (latest_scenes_.size() > kLatestScenes) latest_scenes_.pop_back();
    if (purpose == Purpose::preparation) {
      prepared_.insert(key);
      prepared_bytes_ += reservation.bytes();
      ++statistics_.prepared;
    }
    return dem::Cache<ContentKey, Scene, ContentKeyHash>::Loaded{made, made->bytes};
  };
  std::shared_ptr<const Scene> scene = scenes_.get(key, make, stop);
  if (purpose == Purpose::frame) {
    const std::lock_guard lock(scenes_mutex_);
    statistics_.used += prepared_.erase(key);
    prepared_bytes_ = 0;
  }
  return scene;
}

// Returns whether a scene may be prepared now. It must leave the latest scene in the cache. All scenes prepared after
// one frame, unless it is only one, take at most half of the cache: otherwise each new one would evict one that is
// needed sooner.
bool RenderCache::fits_for_preparation(std::size_t bytes) {
  if (latest_scene_bytes() + bytes > scenes_.capacity()) return false;
  const std::lock_guard lock(scenes_mutex_);
  return prepared_bytes_ == 0 || prepared_bytes_ + bytes <= scenes_.capacity() / 2;
}

PreparationStatistics RenderCache::preparation_statistics() {
  const std::lock_guard lock(scenes_mutex_);
  statistics_.wasted += std::erase_if(prepared_, [&](const ContentKey& key) { return !scenes_.holds(key); });
  return statistics_;
}

bool RenderCache::holds(const SceneContent& content) const { return scenes_.holds(key_of(content)); }

std::function<bool()> RenderCache::use_of(const SceneContent& content) {
  return [this, key = key_of(content)] { return scenes_.find(key).has_value(); };
}

void RenderCache::forget(const SceneContent& content) {
  scenes_.erase(key_of(content));
  const std::lock_guard lock(scenes_mutex_);
  latest_scenes_.clear();
}

std::shared_ptr<const dem::CraterRoughness> RenderCache::roughness(const dem::Terrain& terrain, const StopToken& stop) {
  using Roughnesses = dem::Cache<int, dem::CraterRoughness>;
  return roughnesses_.get(
      terrain.detail_number(),
      [&] {
        return Roughnesses::Loaded{std::make_shared<const dem::CraterRoughness>(terrain.detailed()->detail(), stop), 1};
      },
      stop);
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

std::shared_ptr<const ScatteredLight> RenderCache::scattered(const StrayLight& law, const Camera& camera,
                                                             const StopToken& stop) {
  ContentHash hash;
  hash.add(law.b0_sr);
  hash.add(law.shoulder);
  hash.add(law.slope);
  hash.add(camera.width);
  hash.add(camera.height);
  hash.add(camera.fx);
  hash.add(camera.fy);
  return scattered_.get(
      hash.key(),
      [&] {
        auto made = std::make_shared<const ScatteredLight>(law, camera, stop);
        return dem::Cache<ContentKey, ScatteredLight, ContentKeyHash>::Loaded{made, made->bytes()};
      },
      stop);
}

void RenderCache::settle() {
  if (scratch_.bytes() > scenes_.capacity() / 4) scratch_.clear();
  reserve();
}

// Splits the budget. Finished scenes get the rest:
//
//   |<------------------ capacity ------------------->|
//   | other data | scenes being built | finished scenes |
void RenderCache::reserve() {
  std::size_t being_built;
  {
    const std::lock_guard lock(reservation_mutex_);
    being_built = reserved_bytes_;
  }
  scenes_.reserve(other_bytes() + being_built);
}

std::size_t RenderCache::latest_scene_bytes() {
  const std::lock_guard lock(scenes_mutex_);
  const auto scene = latest_scenes_.empty() ? nullptr : latest_scenes_.front().lock();
  return scene ? scene->bytes + scene->bytes / 16 : 0;  // 1/16: allowance for entries that come with a scene
}

}  // namespace selenograph::engine
