// Blocks finer than the posts: the surface of the posts, interpolated smoothly, with craters and relief.
//
// Between posts the surface is bicubic (Catmull-Rom; linear along the triangles next to no-data), so that it has no
// facets. It is a function of place and level only: blocks agree on their borders to the bit. Only detail below the
// resolution of the posts is added (detail.h), and the posts' information is preserved: the detail's mean over each
// post's cell, interpolated as the posts are, is subtracted, so that means over cells are the same with and without
// detail (unit.detail has the accuracy). Posts may be closer than what they resolve (resolved_posts.h): then cells are
// as wide as that, and blocks of the posts' own level and coarser ones have detail, too. Where a finer layer overlaps a
// coarser one, each place has the ground of its own layer's posts (layered_posts.h).
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
  class PostsAround;
  // Whether a block has detail, and finer posts are near that it is not made of: the plain terrain's block is then not
  // needed.
  bool of_coarse_posts_alone(const BlockId& id) const;
  // Whether the detail's region, or a crater at its border, reaches a block: decided for whole blocks of posts, so that
  // heights, frames and rays agree on the finest level of a place.
  bool reached(const BlockId& id) const;
  double left_out_size_m(const BlockId& id) const;
  // Posts of a layer and of the coarser layers only, at a block's vertices: heights and sources. Null if there are
  // none.
  std::shared_ptr<Block> posts_beneath(const BlockId& id, const StopToken& stop) const;
  struct Surface;
  // At an extent's posts, which are some of a block or lie around it: of one layer; one over those beneath; of all.
  // What is at a post does not depend on the extent.
  Surface surface_of(const BlockId& id, const BlockExtent& e, const LayeredPosts::Layer& layer,
                     const StopToken& stop) const;
  void blend(Surface& below, const Surface& above, const BlockExtent& e, const LayeredPosts::Layer& layer) const;
  Surface composed(const BlockId& id, const BlockExtent& e, const StopToken& stop) const;
  std::shared_ptr<const Block> made(const BlockId& id, const StopToken& stop) const;
  // From the cache folder, or made and put there.
  std::shared_ptr<const Block> read_or_made(const BlockId& id, const StopToken& stop) const;
  // Heights alone, of a part of a block.
  std::shared_ptr<const Block> quad(const BlockId& id, const BlockExtent& e, const StopToken& stop) const;
  // The block, if it is in memory, or what is made.
  template <typename Make>
  std::shared_ptr<const Block> known_or(const BlockId& id, const StopToken& stop, const Make& make) const;
  // What is made of a block's posts: waits for them first.
  template <typename Make>
  std::shared_ptr<const Block> once_posts_are_there(const BlockId& id, const StopToken& stop, const Make& make) const;
  // Posts of a layer's level; null if there are none.
  std::shared_ptr<const Block> posts_of_layer(const BlockId& id, const StopToken& stop) const;
  // 16 x 16 quads of a block's posts: what is taken from posts is made by parts, since a lander sees few posts.
  struct Part;
  // What is taken from the posts for detail that they don't resolve, at places as far apart as heights that they do.
  std::shared_ptr<const Block> taken(const Part& part, const StopToken& stop) const;
  // Means of the detail over the cells of such places in a part and of so many around it, row by row.
  std::vector<double> cell_means(const Part& part, int around, const StopToken& stop) const;
  std::shared_ptr<Block> make_taken(const Part& part, const StopToken& stop) const;
  // Bounds on a block's heights, from the posts; none where there are voids.
  std::optional<HeightRange> heights_of_posts(const BlockId& id, const LayeredPosts::Layer& layer,
                                              const StopToken& stop) const;
  // Heights are those bounds alone; null where there are voids.
  std::shared_ptr<const Block> outline_of_posts(const BlockId& id, const LayeredPosts::Layer& layer,
                                                const StopToken& stop) const;
  // From a block of a coarser level.
  std::optional<HeightRange> heights_within(const BlockId& id, int level, const StopToken& stop) const;
  enum class Kind { made, taken, beneath, outline };
  template <typename Make>
  std::shared_ptr<const Block> kept(Kind kind, const BlockId& id, const StopToken& stop, const Make& make) const;

  std::shared_ptr<const PyramidTerrain> plain_;
  std::shared_ptr<const Detail> detail_;
  int number_;         // distinguishes its blocks in the cache
  std::uint64_t key_;  // and in the cache folder: of terrain, detail and the way in which ground is made
  LayeredPosts layers_;
};

}  // namespace selenograph::dem
