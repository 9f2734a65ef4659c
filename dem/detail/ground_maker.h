// Makes the ground of a block: for each layer of posts the bicubic surface between its posts, plus the detail that
// these cannot resolve, minus that detail's means over the posts' cells; then blends the layers.
//
//   layer's posts --PostReader--> surface --Detail::add--> + detail --PostReader--> - means     for each layer
//                                                                                      |
//   block <--normals, range-- heights <--blended by the layers' shares (layered_posts.h)
#pragma once

#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/detail/detail.h"
#include "dem/detail/ground_posts.h"
#include "dem/detail/layered_posts.h"
#include "dem/grid/block.h"

namespace selenograph::dem {

// Thread-safe. Call it inside GroundCache::run_in_arena() only.
class GroundMaker {
 public:
  // All references must outlive this object.
  GroundMaker(const PyramidTerrain& plain, const Detail& detail, const LayeredPosts& layers, const GroundPosts& posts)
      : plain_(plain), detail_(detail), layers_(layers), posts_(posts) {}

  // Makes a block; null if it has no valid post. Its error_m bounds the distance to finer levels, its range is that of
  // its own heights.
  std::shared_ptr<Block> block(const BlockId& id, const StopToken& stop) const;
  // Makes the heights of a section of a block; no normals, sources or bounds.
  std::shared_ptr<const Block> heights(const BlockId& id, const BlockExtent& section, const StopToken& stop) const;

 private:
  // Ground at the posts of an extent, row by row.
  struct Surface {
    std::vector<double> posts_m, heights_m;  // without detail, with it
    std::vector<double> fragment_factor;     // what fragments add to the factor of the albedo
    std::vector<SourceMark> sources;
    std::vector<Ground> ground;
    double left_out_m;  // bound on the detail that finer levels add
  };

  // Ground at the posts of an extent, which is a section of the block or its surroundings. The value at a post does not
  // depend on the extent. The three functions evaluate one layer, blend one layer over those below, and combine all.
  Surface layer_surface(const BlockId& id, const BlockExtent& e, const LayeredPosts::Layer& layer,
                        const StopToken& stop) const;
  void blend(Surface& below, const Surface& above, const BlockExtent& e, const LayeredPosts::Layer& layer) const;
  Surface composed_surface(const BlockId& id, const BlockExtent& e, const StopToken& stop) const;
  // Blends values at the posts of an extent by the layers' shares. `add`: adds those of a layer's detail to the value
  // without detail.
  using AddLayer = std::function<void(const LayeredPosts::Layer&, const DirectionGrid&, std::span<double>)>;
  std::vector<double> blended(const BlockId& id, const BlockExtent& e, double without_detail,
                              const AddLayer& add) const;
  // Returns factors of the relief's amplitudes at the posts of an extent; empty: 1 everywhere.
  std::vector<double> relief_factors(const LayeredPosts::Layer& layer, const BlockExtent& e,
                                     const StopToken& stop) const;
  // Returns the heights of the next smaller octave, to be added to those of the block before normals are computed. Its
  // features are 2 to 4 posts wide: too narrow for triangles, wide enough to tilt normals. They cast no shadows.
  std::vector<double> next_octave(const BlockId& id, const BlockExtent& e, const StopToken& stop) const;
  // Returns factors of the albedo at the posts of an extent, without fragments; empty: 1 everywhere.
  std::vector<double> crater_brightness(const BlockId& id, const BlockExtent& e, const StopToken& stop) const;
  // Share of a layer's ground at each post of an extent.
  std::vector<double> shares(const LayeredPosts::Layer& layer, const BlockExtent& e) const;

  const PyramidTerrain& plain_;
  const Detail& detail_;
  const LayeredPosts& layers_;
  const GroundPosts& posts_;
};

}  // namespace selenograph::dem
