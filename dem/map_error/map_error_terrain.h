// The terrain as a map with errors shows it.
//
//   block(id):  blocks of the true terrain --resolution, shift--> ground at the posts --SurfaceError::apply--> block
//
// Without a shift, a block has the posts of the true block. With one, each post is interpolated in the true block that
// lies displaced below it:
//
//   +--------+--------+      true blocks of the same level
//   |   #----+---#    |      #: the block of the map, displaced by the shift
//   |   |    |   |    |
//   +---+----+---+----+      The map's finest level is one finer than that of the true posts: interpolated at their
//   |   #----+---#    |      own spacing, they would lose detail.
//   +--------+--------+
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "dem/detail/unloaded_blocks.h"
#include "dem/map_error/surface_error.h"
#include "dem/terrain/surface_place.h"
#include "dem/terrain/terrain.h"

namespace selenograph::dem {

// Thread-safe as Terrain is.
class MapErrorTerrain final : public TerrainOverlay {
 public:
  // `truth`: the terrain with the detail that the map shows (detail_of_map). MapError::missing_craters_below_m is
  // ignored.
  MapErrorTerrain(std::shared_ptr<const Terrain> truth, const MapError& error);

  const MapError& error() const { return surface_.error(); }

  const Catalogue& catalogue() const override { return truth_->catalogue(); }
  const PyramidTerrain& plain() const override { return truth_->plain(); }
  const DetailedTerrain* detailed() const override { return truth_->detailed(); }
  int detail_number() const override { return number_; }
  const std::vector<BlockId>& roots() const override { return roots_; }
  bool has_data(const BlockId& id) const override;
  int posts_level(const BlockId& id) const override;
  NodeInfo node(const BlockId& id, const StopToken& stop = {}) const override;
  std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop = {}) const override;

  bool has_detail(const BlockId& id) const override;
  bool node_is_cheap(const BlockId& id) const override;
  std::optional<NodeInfo> outline(const BlockId& id, const StopToken& stop) const override;
  std::optional<HeightRange> heights_without_building(const BlockId& id, const StopToken& stop) const override;

 private:
  // Returns the true blocks from which a block is made.
  std::vector<BlockId> true_blocks(const BlockId& id) const;
  // Returns bounds on the heights that ground between two heights gets in a block.
  HeightRange bounds(const BlockId& id, const HeightRange& ground) const;
  // Return a block with the true ground at the posts, before SurfaceError::apply; null without data: as it is, or
  // interpolated where it is displaced or finer than the map's resolution.
  std::shared_ptr<Block> unchanged_ground(const BlockId& id, const StopToken& stop) const;
  std::shared_ptr<Block> interpolated_ground(const BlockId& id, const StopToken& stop) const;
  // Returns the place of the true ground that a vertex of a block shows.
  Ticks true_place(const Block& block, int r, int c) const;
  void apply_errors(Block& block, const StopToken& stop) const;

  const std::shared_ptr<const Terrain> truth_;
  const SurfaceError surface_;
  const bool shifted_;
  const int coarsest_posts_;  // the finest level of the true terrain that the map's resolution shows
  const int number_;
  std::vector<BlockId> roots_;
};

}  // namespace selenograph::dem
