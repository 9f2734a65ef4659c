// Blocks finer than the posts: the posts' own surface, smooth between them, with craters and relief on it.
//
// Between posts the surface is Catmull-Rom's bicubic through them (linear along the triangles beside voids), so that it
// has no facets. All of it is a function of the place and the level: blocks agree on their borders to the bit, whoever
// makes them. A detail is shown where the posts are too far apart for it (detail.h): what they can show they have. And
// it keeps what they say: before they are interpolated, the detail's mean over each post's cell is taken from the post,
// so that means over cells of the ground with detail are those of the ground without (unit.detail says how nearly).
#pragma once

#include <memory>

#include "dem/cache.h"
#include "dem/detail/detail.h"
#include "dem/terrain.h"

namespace selenograph::dem {

// Const means safe to call concurrently. What is said of Terrain's functions holds of these.
class DetailedTerrain {
 public:
  using Blocks = Cache<BlockId, Block, BlockIdHash>;
  // `plain` and `blocks` outlive it. The blocks are kept among the plain ones, told apart by the number, which no other
  // of the same cache has.
  DetailedTerrain(const Terrain& plain, std::shared_ptr<const Detail> detail, Blocks& blocks, int number);

  const Detail& detail() const { return *detail_; }
  int number() const { return number_; }
  bool has_data(const BlockId& id) const;
  int finest_level(const BlockId& id) const;
  NodeInfo node(const BlockId& id, const StopToken& stop) const;
  std::shared_ptr<const Block> block(const BlockId& id, const StopToken& stop) const;
  // Of the posts' heights, by what detail may do to them.
  void widen(const BlockId& id, HeightRange& range) const;

 private:
  class PostsAround;
  // Whether the detail's region does, or what stands in it: decided for whole blocks of posts, so that heights, frames
  // and rays agree on which level is a place's finest.
  bool reached(const BlockId& id) const;
  std::shared_ptr<const Block> made(const BlockId& id, int posts_level, const StopToken& stop) const;
  // Posts with the detail's means taken from them; null where there are none.
  std::shared_ptr<const Block> corrected(const BlockId& id, const StopToken& stop) const;
  std::shared_ptr<Block> make_corrected(const Block& posts, const StopToken& stop) const;
  template <typename Make>
  std::shared_ptr<const Block> kept(const BlockId& id, const StopToken& stop, const Make& make) const;

  const Terrain& plain_;
  std::shared_ptr<const Detail> detail_;
  Blocks& blocks_;
  int number_;
};

}  // namespace selenograph::dem
