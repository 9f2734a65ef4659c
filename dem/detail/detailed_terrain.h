// Blocks finer than the posts: the surface of the posts, interpolated smoothly, with craters and relief.
//
// Between posts the surface is bicubic (Catmull-Rom; linear along the triangles next to no-data), so that it has no
// facets. It is a function of position and level only: blocks agree on their borders to the bit. Only detail below the
// resolution of the posts is added (detail.h), and the posts' information is preserved: the detail's mean over each
// post's cell, interpolated as the posts are, is subtracted, so that means over cells are the same with and without
// detail (unit.detail has the accuracy). Posts may be closer than what they resolve (resolved_posts.h): then cells are
// as wide as that, and blocks of the posts' own level and coarser ones have detail, too. Where a finer layer overlaps a
// coarser one, each position has the ground of its own layer's posts (layered_posts.h).
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "dem/detail/detail.h"
#include "dem/detail/layered_posts.h"
#include "dem/terrain/pyramid_terrain.h"

namespace selenograph::dem {

class DetailedTerrain final : public Terrain {
 public:
  // Blocks are cached together with the plain ones, on the same memory budget.
  DetailedTerrain(std::shared_ptr<const PyramidTerrain> plain, std::shared_ptr<const Detail> detail);

  const Catalogue& catalogue() const override { return plain_->catalogue(); }
  const Terrain& plain() const override { return *plain_; }
  const Detail* detail() const override { return detail_.get(); }
  bool has_detail(const BlockId& id) const override;
  std::vector<DetailOfPosts> detail_at(double lat_deg, double lon_deg) const override {
    return layers_.at(lat_deg, lon_deg);
  }
  int detail_number() const override { return number_; }

  const std::vector<BlockId>& roots() const override { return plain_->roots(); }
  bool has_data(const BlockId& id) const override;
  int posts_level(const BlockId& id) const override;
  bool node_is_cheap(const BlockId& id) const override { return plain_->node_is_cheap(id) || has_detail(id); }
  NodeInfo node(const BlockId& id, const StopToken& stop = {}) const override;
  std::optional<NodeInfo> outline(const BlockId& id, const StopToken& stop) const override;
  std::optional<HeightRange> heights_without_building(const BlockId& id, const StopToken& stop = {}) const override;
  bool waits_for_network(const BlockId& id) const override { return plain_->waits_for_network(id); }
  std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop = {}) const override;
  std::shared_ptr<const Block> block_or_quad(const BlockId& id, std::int32_t lat, std::int32_t lon,
                                             const StopToken& stop = {}) const override;
  bool has_replacements() const override { return plain_->has_replacements(); }

 private:
  class PostReader;
  struct SubBlock;
  struct Surface;
  enum class Kind { block, mean_correction, layer_posts, outline };

  // Returns whether a block has detail, only coarse posts enter it, and finer posts lie near. Such a block does not
  // need the plain terrain's block.
  bool uses_coarse_posts_only(const BlockId& id) const;
  // Returns whether the detail's region, or a crater at its border, reaches a block. The block of posts decides for all
  // its descendants, so that heights, frames and rays agree on the finest level at a position.
  bool detail_reaches(const BlockId& id) const;
  double left_out_size_m(const BlockId& id) const;

  // Posts of a layer's level; null if there are none.
  std::shared_ptr<const Block> posts_of_layer(const BlockId& id, const StopToken& stop) const;
  // Composes heights and sources of a layer and of all coarser layers at a block's vertices. Null if there are none.
  std::shared_ptr<Block> compose_layer_posts(const BlockId& id, const StopToken& stop) const;

  // Ground at the posts of an extent, which is a section of the block or its surroundings. The value at a post does not
  // depend on the extent. The three functions evaluate one layer, blend one layer over those below, and combine all.
  Surface layer_surface(const BlockId& id, const BlockExtent& e, const LayeredPosts::Layer& layer,
                        const StopToken& stop) const;
  void blend(Surface& below, const Surface& above, const BlockExtent& e, const LayeredPosts::Layer& layer) const;
  Surface composed_surface(const BlockId& id, const BlockExtent& e, const StopToken& stop) const;

  std::shared_ptr<const Block> make_block(const BlockId& id, const StopToken& stop) const;
  // Reads the block from the cache folder, or makes it and stores it there.
  std::shared_ptr<const Block> read_or_make_block(const BlockId& id, const StopToken& stop) const;
  // Makes the heights of one quad; no normals, sources or bounds.
  std::shared_ptr<const Block> make_quad(const BlockId& id, const BlockExtent& e, const StopToken& stop) const;

  // Returns the block if it is in memory, else the result of make().
  template <typename Make>
  std::shared_ptr<const Block> cached_block_or(const BlockId& id, const StopToken& stop, const Make& make) const;
  // Waits for the pyramid of a block's posts, then runs make() in the arena (deadlocks: detailed_terrain.cpp).
  template <typename Make>
  std::shared_ptr<const Block> make_in_arena(const BlockId& id, const StopToken& stop, const Make& make) const;
  // Returns the cached object of a kind; the first of concurrent callers makes it.
  template <typename Make>
  std::shared_ptr<const Block> cached(Kind kind, const BlockId& id, const StopToken& stop, const Make& make) const;

  // Heights to subtract at a sub-block's posts: the means of unresolved detail over the posts' cells. Posts and cells
  // are those of the layer's detail level.
  std::shared_ptr<const Block> mean_correction(const SubBlock& sub_block, const StopToken& stop) const;
  std::shared_ptr<Block> make_mean_correction(const SubBlock& sub_block, const StopToken& stop) const;
  // Returns the means of the detail over the cells of a sub-block and of `margin` cells around it, row by row.
  std::vector<double> cell_means(const SubBlock& sub_block, int margin, const StopToken& stop) const;

  // Bounds on a block's heights, from the layer's posts; empty if posts are missing.
  std::optional<HeightRange> bounds_from_posts(const BlockId& id, const LayeredPosts::Layer& layer,
                                               const StopToken& stop) const;
  // Makes a cache entry of these bounds alone; null if posts are missing.
  std::shared_ptr<const Block> make_posts_outline(const BlockId& id, const LayeredPosts::Layer& layer,
                                                  const StopToken& stop) const;
  // Bounds on a block's heights, from its ancestor of a coarser level.
  std::optional<HeightRange> bounds_from_ancestor(const BlockId& id, int level, const StopToken& stop) const;

  std::shared_ptr<const PyramidTerrain> plain_;
  std::shared_ptr<const Detail> detail_;
  int number_;         // distinguishes this terrain's blocks in the memory cache
  std::uint64_t key_;  // key in the cache folder: hash of terrain, preset and kGroundVersion
  LayeredPosts layers_;
};

}  // namespace selenograph::dem
