// The terrain with detail: which blocks have it, and bounds and errors of nodes; how ground is made is ground_maker.h.
//
// Between posts the surface is bicubic, so that it has no facets, with craters, relief and clods. Only detail below the
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
#include "dem/detail/ground_cache.h"
#include "dem/detail/ground_maker.h"
#include "dem/detail/ground_posts.h"
#include "dem/detail/layered_posts.h"
#include "dem/terrain/pyramid_terrain.h"

namespace selenograph::dem {

class DetailedTerrain final : public Terrain {
 public:
  // Blocks are cached together with the plain ones, on the same memory budget.
  DetailedTerrain(std::shared_ptr<const PyramidTerrain> plain, std::shared_ptr<const Detail> detail);

  const Catalogue& catalogue() const override { return plain_->catalogue(); }
  const PyramidTerrain& plain() const override { return *plain_; }
  const DetailedTerrain* detailed() const override { return this; }
  int detail_number() const override { return cache_.number(); }
  const std::vector<BlockId>& roots() const override { return plain_->roots(); }
  bool has_data(const BlockId& id) const override;
  int posts_level(const BlockId& id) const override;
  NodeInfo node(const BlockId& id, const StopToken& stop = {}) const override;
  std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop = {}) const override;

  const Detail& detail() const { return *detail_; }
  // Returns whether a block has detail: it is finer than the distance that its posts resolve.
  bool has_detail(const BlockId& id) const;
  // Returns the layers whose detail is shown at a position, from coarse to fine.
  std::vector<DetailOfPosts> detail_at(double lat_deg, double lon_deg) const { return layers_.at(lat_deg, lon_deg); }
  // Returns the factor of the relief's amplitudes (Detail::add) at a position, over posts of which a level is resolved.
  double relief_factor(double lat_deg, double lon_deg, int detail_level, const StopToken& stop = {}) const;
  // Returns the block if it is available, else only its quad at a position in ticks: the same heights to the bit, no
  // normals, sources or bounds. For callers that need few positions of a block.
  std::shared_ptr<const Block> block_or_quad(const BlockId& id, Tick lat, Tick lon, const StopToken& stop = {}) const;

  // As the functions of unloaded_blocks.h.
  std::optional<NodeInfo> outline(const BlockId& id, const StopToken& stop = {}) const;
  std::optional<HeightRange> heights_without_building(const BlockId& id, const StopToken& stop = {}) const;

 private:
  // Returns whether a block has detail, only coarse posts enter it, and finer posts lie near. Such a block does not
  // need the plain terrain's block.
  bool uses_coarse_posts_only(const BlockId& id) const;
  // Returns whether the detail's region, or a crater at its border, reaches a block. The block of posts decides for all
  // its descendants, so that heights, frames and rays agree on the finest level at a position.
  bool detail_reaches(const BlockId& id) const;
  double left_out_size_m(const BlockId& id) const;
  // Returns the block of posts whose pyramid must be built before a block is made; empty: its files are enough.
  std::optional<BlockId> posts_to_await(const BlockId& id) const;

  // Makes the ground and bounds its errors.
  std::shared_ptr<const Block> make_block(const BlockId& id, const StopToken& stop) const;

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
  LayeredPosts layers_;
  GroundCache cache_;
  GroundPosts posts_;
  GroundMaker maker_;
};

}  // namespace selenograph::dem
