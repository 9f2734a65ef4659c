// Whose posts ground with detail is made of, where layers of different resolution lie over each other.
//
// Within the outlines of a layer's files it is that layer's, and beyond them the next coarser one's, with all the
// detail that the coarser posts are too far apart for. Posts go from one to the other over a band outside of the
// outlines, from composed posts to the coarser layer's own curved surface. The coarser layer's detail ends where its
// posts do: over the band inside in which they are blended into the finer layer (layer_edges.h), or over the one
// outside where there is none.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <unordered_map>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/grid/block.h"
#include "dem/posts/layer_edges.h"
#include "dem/terrain/pyramid_terrain.h"

namespace selenograph::dem {

// Const means safe to call concurrently.
class LayeredPosts {
 public:
  // `plain` outlives it. `widest_m`: of what appears over a band, which is as wide, or as two posts of the coarser
  // layer, if that is less.
  LayeredPosts(const PyramidTerrain& plain, double widest_m);

  struct Layer {
    int level;          // that has its posts
    double band_m = 0;  // beyond its outlines
    // Its own and all finer ones; none of the first of a block's, which is beneath the others.
    std::vector<int> files{};
  };
  using Layers = std::shared_ptr<const std::vector<Layer>>;
  // Those that count somewhere in a block, from coarse to fine; one at least.
  Layers of(const BlockId& id) const;
  // The level of the first of them.
  int coarsest(const BlockId& id) const;
  // How much a layer and those finer count against those beneath: their posts, and the detail that goes with them.
  struct Share {
    double posts, detail;  // 0 to 1
  };
  // In a block and beside it.
  class Shares {
   public:
    Share at(double lat_deg, double lon_deg) const;

   private:
    friend class LayeredPosts;
    struct File {
      int number;
      bool blended;  // over a band of its own
      std::optional<LayerEdges::Shares> beneath;
    };
    const LayeredPosts* layers_ = nullptr;
    double band_m_ = 0;
    std::vector<File> files_;
  };
  Shares shares(const Layer& layer, const BlockId& id) const;
  // How many of the catalogue's files, from the first on, have no finer posts than a level shows.
  int files_up_to(int level) const;
  // Whose detail there is at a place, from coarse to fine: the shares' sum is 1.
  std::vector<DetailOfPosts> at(double lat_deg, double lon_deg) const;

 private:
  std::vector<Layer> found(const BlockId& id) const;
  Shares shares(const Layer& layer, const Footprint& box) const;

  const PyramidTerrain& plain_;
  double widest_m_;
  mutable std::mutex mutex_;
  mutable std::unordered_map<BlockId, Layers, BlockIdHash> known_;
};

}  // namespace selenograph::dem
