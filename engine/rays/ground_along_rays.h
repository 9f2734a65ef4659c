// The scene that rays are cast against: the finest terrain along them, and the objects and rocks on it.
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
#include "engine/cache/render_context.h"
#include "engine/frame/request.h"
#include "engine/visibility/objects/objects_in_frame.h"
#include "engine/visibility/objects/rocks_near_rays.h"
#include "engine/visibility/points/scene.h"

namespace selenograph::engine {

// A map of rocks from above. A packet of rays that passes no cell with a rock before it hits the terrain skips the
// tracing of rocks, which takes as long as that of the terrain.
//
//   +--+--+--+--+   A square in the tangent plane of the rocks' centre, 2 * half_side_m_ wide, holds all rocks.
//   |  |##|  |  |   Cells that a rock reaches count 1. The summed-area table tells how many such cells a rectangle
//   +--+--+--+--+   contains: the rectangle around the packet's segments between the shell (above which there is
//   |  |  |  |##|   no rock) and the terrain.
//   +--+--+--+--+
class RockCells {
 public:
  explicit RockCells(std::span<const dem::RockFeature> rocks);
  // Returns false only if no valid ray hits a rock in front of its hit on the terrain. Conservative.
  bool may_hit(const Rays& rays, const SurfacePoints& terrain) const;

 private:
  std::uint32_t count_cells_with_rocks(int x0, int y0, int x1, int y1) const;  // in a rectangle, bounds included
  int cell(double m) const;

  Vec3 centre_m_ = Vec3::zero();
  EastNorthUp axes_{};
  double shell_m_ = 0;      // radius around the Moon's centre that contains all rocks
  double half_side_m_ = 0;  // half the side of the square that contains all rocks
  int cells_per_side_ = 0;
  std::vector<std::uint32_t> area_sums_;  // summed-area table from the south-west, (cells_per_side_ + 1)^2
};

// Objects on the terrain of a scene: the query's objects, and rocks.
class SceneryOnGround {
 public:
  // `objects_only`: the query's objects without rocks; must outlive this object.
  SceneryOnGround(const ObjectsInFrame& objects_only, const FrameRequest& request, std::vector<dem::RockFeature> rocks,
                  const StopToken& stop)
      : objects_only_(objects_only), rocks_(std::move(rocks)) {
    if (rocks_.empty()) return;
    objects_and_rocks_.emplace(request, rocks_, stop);
    cells_.emplace(rocks_);
  }
  // Intersects as ObjectsInFrame::meet does. `out` is written in the lanes that hit an object.
  std::uint32_t intersect(Rays& rays, SurfacePoints& terrain, ObjectLanes& out) const {
    const bool rocks_only = objects_only_.empty() && cells_;
    return rocks_only && !cells_->may_hit(rays, terrain) ? 0 : objects().intersect(rays, terrain, out);
  }
  const ObjectsInFrame& objects() const { return objects_and_rocks_ ? *objects_and_rocks_ : objects_only_; }
  std::optional<std::uint16_t> object(std::uint16_t index) const {
    return objects().rock(index) ? std::nullopt : std::optional(index);
  }
  std::optional<std::uint64_t> rock(std::uint16_t index) const {
    const auto number = objects().rock(index);
    return number ? std::optional(rocks_[*number].rock.id) : std::nullopt;
  }
  // Call before index_of_rock().
  void index_rocks() {
    for (std::size_t i = 0; i < rocks_.size(); ++i)
      index_of_id_.emplace(rocks_[i].rock.id, objects_and_rocks_->index_of_rock(i));
  }
  // Returns the object index of a rock (and of the soil against it); kNoObject if the scene lacks the rock.
  std::uint16_t index_of_rock(std::uint64_t id) const {
    const auto found = index_of_id_.find(id);
    return found == index_of_id_.end() ? kNoObject : found->second;
  }

 private:
  const ObjectsInFrame& objects_only_;
  std::vector<dem::RockFeature> rocks_;
  std::optional<ObjectsInFrame> objects_and_rocks_;  // empty without rocks
  std::optional<RockCells> cells_;
  std::unordered_map<std::uint64_t, std::uint16_t> index_of_id_;
};

// Returns the length of a ray's next step over ground with detail. Blocks with detail take long to build, so a ray is
// followed in growing steps, and a hit nearer than the followed length is final:
//
//   origin --16 m--|----64 m----|--- ... ---|--8 m past the hit on the posts' surface--|-- ... --> infinity
//
// `reach_m`: the length followed so far, 0 at first. `posts_m`: range of the hit on the surface without detail; NaN:
// none.
double next_reach_m(double reach_m, double posts_m);

class GroundAlongRays {
 public:
  // `ray_description`: a ray in the words of the request, the subject of error messages. `scenery`: its objects, and
  // its ground (for reflected light), are used. The context must outlive this object.
  GroundAlongRays(const char* ray_description, FrameRequest scenery, const RenderContext& context);

  const ObjectsInFrame& objects() const { return objects_; }  // without rocks
  // Returns the finest level of the blocks of scenes with this limit of detail.
  int finest_ground(int finest_detail) const;
  // Returns false if all rays end above the ground and the rocks on it. Makes coarse blocks of detail only.
  bool may_meet_ground(const std::vector<RayCone>& rays) const;

  struct GroundScene {
    std::shared_ptr<const Scene> scene;
    SceneryOnGround scenery;
    bool empty;  // no terrain, no object
  };
  // Builds the scene along the rays. Null if it would have too many blocks or rocks: split the rays and try each half.
  // `indivisible`: the rays cannot be split; then TooMuchTerrain is thrown instead. `finest_detail`: the finest level
  // of blocks with detail; rocks up to its post spacing are left out.
  std::unique_ptr<GroundScene> build_scene(const std::vector<RayCone>& rays, bool indivisible,
                                           int finest_detail = dem::kMaxLevel);

 private:
  std::optional<std::vector<dem::RockFeature>> rocks_along(const std::vector<RayCone>& rays,
                                                           const std::vector<BlockOnRays>& blocks, int finest_detail);

  const char* const ray_description_;
  const FrameRequest scenery_;
  const ObjectsInFrame objects_;
  std::optional<RocksNearRays> rocks_;  // empty for terrain without rocks
  const RenderContext& context_;
};

}  // namespace selenograph::engine
