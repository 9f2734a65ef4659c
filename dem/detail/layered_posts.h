// Selects the layer of posts from which ground with detail is made, where layers of different resolution overlap.
//
// Inside the outlines of a layer's files the ground is that layer's; outside it is the next coarser layer's, bent to
// meet the finer one (layer_bends.h), with all detail that the coarser posts cannot resolve. Posts and detail change
// from one layer to the other over a band outside the outlines:
//
//          coarser layer, its detail
//     +..........................+   share of the finer layer: 0 outside the band, smooth within it, 1 inside
//     :   +------------------+   :
//     :   |   finer layer,   |   :   ---- outline of its files        .... end of the band (band_m outside)
//     :   |   its detail     |   :
//     :   +------------------+   :
//     +..........................+
#pragma once

#include <array>
#include <compare>
#include <memory>
#include <mutex>
#include <unordered_map>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/grid/block.h"
#include "dem/terrain/pyramid_terrain.h"

namespace selenograph::dem {

// Share of a layer's detail at a position: at layer borders, several layers contribute.
struct DetailOfPosts {
  int level;  // level whose post spacing is the distance that the layer resolves
  double share;
};

// Thread-safe: const functions may be called concurrently.
class LayeredPosts {
 public:
  // `plain` must outlive this object. `widest_m`: width of the widest feature of the detail, m. A band is as wide as
  // that, or as twice the distance that the coarser layer resolves if that is less.
  LayeredPosts(const PyramidTerrain& plain, double widest_m);

  struct Layer {
    int level;          // level of its posts
    int detail_level;   // level whose post spacing is the distance that the layer resolves; detail is finer than that
    double band_m = 0;  // width of the band outside its outlines, m
    // Files of this layer and of all finer ones; empty for the coarsest layer of a block.
    std::vector<int> files{};
  };
  using Layers = std::shared_ptr<const std::vector<Layer>>;
  // Returns the layers with a share anywhere in a block, from coarse to fine; at least one.
  Layers of(const BlockId& id) const;
  // Returns the posts' level of the coarsest of these layers.
  int coarsest(const BlockId& id) const;
  // Returns the coarsest detail level of these layers.
  int coarsest_detail(const BlockId& id) const;
  // Returns the weight of a layer and all finer ones against the coarser ones at a position, 0 to 1.
  double share(const Layer& layer, double lat_deg, double lon_deg) const;
  // Posts whose roughness the relief follows: the finest of the layers with a detail level, and the largest step
  // between representable heights of their files, m.
  struct RoughnessPosts {
    int level;
    double quantisation_m = 0;
  };
  RoughnessPosts roughness_posts(int detail_level) const;
  // Returns the number of files, from the first of the catalogue, whose posts a level can show.
  int files_up_to(int level) const;
  // Returns the layers whose detail is shown at a position, from coarse to fine; the shares sum to 1.
  std::vector<DetailOfPosts> at(double lat_deg, double lon_deg) const;

 private:
  std::vector<Layer> find_layers(const BlockId& id) const;
  Layer layer_of(int level) const { return {level, level - coarser_by_[static_cast<std::size_t>(level)]}; }
  // Files of one posts' level may resolve different distances: each such group is a layer.
  struct Levels {
    int posts, detail;
    auto operator<=>(const Levels&) const = default;
  };

  const PyramidTerrain& plain_;
  double widest_m_;
  std::vector<Levels> levels_of_files_;
  // Levels from posts to detail, by the posts' level: the largest difference of any file.
  std::array<int, kMaxLevel + 1> coarser_by_{};
  mutable std::mutex mutex_;  // guards layers_of_blocks_
  mutable std::unordered_map<BlockId, Layers, BlockIdHash> layers_of_blocks_;
};

}  // namespace selenograph::dem
