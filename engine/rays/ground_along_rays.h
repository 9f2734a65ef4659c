// Everything that rays may hit: the finest terrain along them as a scene, and the objects and rocks on it.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <unordered_map>
#include <utility>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/terrain/terrain.h"
#include "engine/cache/render_cache.h"
#include "engine/frame/queries.h"
#include "engine/frame/request.h"
#include "engine/visibility/objects/objects_in_frame.h"
#include "engine/visibility/objects/rocks_near_rays.h"
#include "engine/visibility/points/scene.h"

namespace selenograph::engine {

// Where rocks are, from above: a packet of rays that passes none of them on its way to the terrain need not be traced
// against them, which takes as long as the terrain does.
class RockCells {
 public:
  explicit RockCells(std::span<const dem::RockFeature> rocks);
  // Whether a valid ray may meet one before what it meets of the terrain, if anything.
  bool may_meet(const Rays& rays, const SurfacePoints& terrain) const;

 private:
  std::uint32_t number_in(int x0, int y0, int x1, int y1) const;  // of cells with rocks
  int cell(double m) const;

  Vec3 middle_ = Vec3::Zero();
  EastNorthUp axes_{};
  double shell_m_ = 0;               // radius around the Moon's centre that holds all of them
  double half_m_ = 0;                // of the square that does
  int side_ = 0;                     // in cells
  std::vector<std::uint32_t> sums_;  // of all cells to the south-west, (side_ + 1)^2
};

// Objects on the terrain of a scene: those of the query, and rocks.
class SceneryOnGround {
 public:
  SceneryOnGround(const ObjectsInFrame& without, const FrameRequest& request, std::vector<dem::RockFeature> rocks,
                  const StopToken& stop)
      : without_(without), rocks_(std::move(rocks)) {
    if (rocks_.empty()) return;
    with_.emplace(request, rocks_, stop);
    cells_.emplace(rocks_);
  }
  // As ObjectsInFrame::intersect; `out` is written where a lane meets something.
  std::uint32_t meet(Rays& rays, SurfacePoints& terrain, ObjectLanes& out) const {
    const bool rocks_alone = without_.empty() && cells_;
    return rocks_alone && !cells_->may_meet(rays, terrain) ? 0 : objects().intersect(rays, terrain, out);
  }
  const ObjectsInFrame& objects() const { return with_ ? *with_ : without_; }
  std::optional<std::uint16_t> object(std::uint16_t index) const {
    return objects().rock(index) ? std::nullopt : std::optional(index);
  }
  std::optional<std::uint64_t> rock(std::uint16_t index) const {
    const auto number = objects().rock(index);
    return number ? std::optional(rocks_[*number].rock.id) : std::nullopt;
  }
  // So that index_of_rock() knows them.
  void number_rocks() {
    for (std::size_t i = 0; i < rocks_.size(); ++i) numbers_.emplace(rocks_[i].rock.id, with_->index_of_rock(i));
  }
  // Of what rays met: a rock or the soil against it.
  std::uint16_t index_of_rock(std::uint64_t id) const {
    const auto found = numbers_.find(id);
    return found == numbers_.end() ? kNoObject : found->second;
  }

 private:
  const ObjectsInFrame& without_;
  std::vector<dem::RockFeature> rocks_;
  std::optional<ObjectsInFrame> with_;
  std::optional<RockCells> cells_;
  std::unordered_map<std::uint64_t, std::uint16_t> numbers_;
};

// How far a ray is followed next over ground with detail, which takes long to make: a little more while it meets
// nothing, to somewhat past where it meets the posts' own surface (`posts_m`; NaN: nowhere), and to its end (infinite).
// What it meets nearer than it was followed is what it meets. `reach_m`: how far it was followed, 0 at first.
double next_reach_m(double reach_m, double posts_m);

class GroundAlongRays {
 public:
  // `a_ray`: what a ray is in the words of the request. `scenery`: whose objects and ground (for what they reflect)
  // these are. The other arguments must outlive this object.
  GroundAlongRays(const char* a_ray, FrameRequest scenery, const dem::Terrain& terrain, RenderCache& kept,
                  const StopToken& stop);

  const ObjectsInFrame& objects() const { return objects_; }  // without rocks

  struct Part {
    std::shared_ptr<const Scene> scene;
    SceneryOnGround scenery;
    bool empty;  // no terrain, no object
  };
  // Null where there is more terrain along the rays than one scene should hold, or more rocks: ask for some of them at
  // a time. `last`: they can't be fewer, and ImpossibleRequest (TooMuchTerrain) is thrown. `finest_detail`: the finest
  // level of ground with detail; with it, rocks that are no larger than the spacing of its posts are left out.
  std::unique_ptr<Part> along(const std::vector<RayCone>& rays, bool last, int finest_detail = dem::kMaxLevel);

 private:
  std::optional<std::vector<dem::RockFeature>> rocks_along(const std::vector<RayCone>& rays,
                                                           const std::vector<BlockOnRays>& blocks, int finest_detail);

  const char* const a_ray_;
  const FrameRequest scenery_;
  const ObjectsInFrame objects_;
  std::optional<RocksNearRays> rocks_;  // of terrain that has some
  const dem::Terrain& terrain_;
  RenderCache& kept_;
  const StopToken& stop_;
};

}  // namespace selenograph::engine
