// Selects the layer whose posts ground with detail is made from, where layers of different resolution overlap.
//
// Within the outlines of a layer's files the ground is that layer's; beyond them it is the next coarser layer's, bent
// to meet the finer one (layer_bends.h), with all detail that the coarser posts cannot resolve. Posts and detail change
// from one to the other over a band outside the outlines, from composed posts to the coarser layer's own curved
// surface.
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

// Thread-safe: const functions may be called concurrently.
class LayeredPosts {
 public:
  // `plain` must outlive this object. `widest_m`: width of the widest feature that appears over a band; the band is as
  // wide, or as two posts of the coarser layer if that is less.
  LayeredPosts(const PyramidTerrain& plain, double widest_m);

  struct Layer {
    int level;          // level of its posts
    int detail_level;   // of posts as far apart as what it resolves: detail is what they are too far apart for
    double band_m = 0;  // beyond its outlines
    // Files of this layer and of all finer ones; empty for the coarsest layer of a block.
    std::vector<int> files{};
  };
  using Layers = std::shared_ptr<const std::vector<Layer>>;
  // Layers that count anywhere in a block, from coarse to fine; at least one.
  Layers of(const BlockId& id) const;
  // Level of the coarsest of them.
  int coarsest(const BlockId& id) const;
  // The coarsest level of their detail.
  int coarsest_detail(const BlockId& id) const;
  // Weight of a layer and the finer ones against the coarser ones at a place, 0 to 1.
  double share(const Layer& layer, double lat_deg, double lon_deg) const;
  // Number of the catalogue's first files whose posts are no finer than a level shows.
  int files_up_to(int level) const;
  // Layers whose detail is shown at a place, from coarse to fine; the shares sum to 1.
  std::vector<DetailOfPosts> at(double lat_deg, double lon_deg) const;

 private:
  std::vector<Layer> found(const BlockId& id) const;
  Layer layer_of(int level) const { return {level, level - coarser_by_[static_cast<std::size_t>(level)]}; }
  // Files whose posts are of one level may resolve different things: each such group is a layer.
  struct Levels {
    int posts, detail;
    auto operator<=>(const Levels&) const = default;
  };

  const PyramidTerrain& plain_;
  double widest_m_;
  std::vector<Levels> levels_of_files_;
  std::array<int, kMaxLevel + 1> coarser_by_{};  // by the posts' level: the most of any file
  mutable std::mutex mutex_;
  mutable std::unordered_map<BlockId, Layers, BlockIdHash> known_;
};

}  // namespace selenograph::dem
