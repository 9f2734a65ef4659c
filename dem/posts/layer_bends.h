// Bends coarser layers until they meet the posts of finer ones.
//
// Every valid post of a finer layer is the surface, unchanged. Where the layer has none, the coarser surface b becomes
// b + c: c is the step from b to the finer posts along their border, carried outward, and fades over the band:
//
//                                        ___---
//     finer posts    o---o---o   ___-----   b + c joins b
//                             ---           '
//     c              0           |||...     0
//     coarser, b     - - - - - - - - ------'---------
//                            |<--- band --->|
//
// Layers are added from coarse to fine: the step of a layer is measured from the coarser ones as they are bent already.
// Rasters of equal resolution are one layer and do not bend each other.
//
// c is built octave by octave (border_cells.h). In each, the steps of border cells are averaged with weights that fall
// with the fourth power of the distance; a finer octave takes over within four of its cells from the border. Coarser
// octaves are refined by subdivision of quadratic B-splines (Chaikin 1974). At a border post c is that post's own step.
// c is a function of the place only: the same from any window, level, tile and number of threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "dem/base/once.h"
#include "dem/catalogue/catalogue.h"
#include "dem/grid/block.h"
#include "dem/posts/border_cells.h"
#include "dem/posts/layer_groups.h"

namespace selenograph::dem {

// Places in rows and columns, each with the source that shows there.
struct PlaceGrid {
  int rows = 0, columns = 0;
  std::function<Geographic(int row, int column)> place;
  std::span<const SourceMark> sources;  // row by row; kNoSource: no data
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(c);
  }
};

// Smallest box of latitudes and longitudes around places.
struct PlaceBox {
  double south_deg = 90, north_deg = -90;
  double west_deg = 0, east_deg = 0;  // east >= west
  void add(const Geographic& place);
  bool empty() const { return south_deg > north_deg; }
};

struct Bends {
  std::vector<float> added_m;  // per place; empty: nothing is bent
  std::vector<float> away_m;   // distance from the nearest finer layer near its border; grows to infinity over the band
  std::vector<SourceIndex> unusable{};
};

// Thread-safe: const functions may be called concurrently.
class LayerBends {
 public:
  // As BorderCells.
  LayerBends(const Catalogue& catalogue, ReadPosts read, HeightsBeneath beneath, bool fall_through);
  ~LayerBends();

  // Width of the band outside its group in posts of the file; 0: nothing is bent. Reads no posts.
  double band_posts(int source) const;
  // The widest band of any group, degrees of latitude.
  double widest_band_deg() const { return found().groups.widest_band_deg; }
  // Files of its group, ascending.
  const std::vector<int>& group_of(int source) const;

  // What finer layers add to the heights at places whose source is coarser. Only layers that begin before file `past`
  // count.
  Bends at(const PlaceGrid& places, int past) const;

  // Border posts of a file's group: about one for each half post of the coarser layer along the border, some 256 for a
  // small group, at most `most`, evenly spread. Empty for groups that are too large.
  std::vector<BorderPost> border(int source, std::size_t most) const;

 private:
  struct Field;
  struct Shares;
  class Mixture;
  struct Found {  // created on first use
    Found(const Catalogue& catalogue, const ReadPosts& read, const HeightsBeneath& beneath, bool fall_through)
        : groups(find_groups(catalogue)), cells(catalogue, groups, read, beneath, fall_through) {}
    LayerGroups groups;
    BorderCells cells;
  };
  const Found& found() const;
  bool can_bend(SourceMark mark, int layer_begin) const {
    const SourceIndex source = source_of(mark);
    return source != kNoSource && catalogue_.layer_begin(static_cast<int>(source)) < layer_begin;
  }
  std::vector<const LayerGroup*> groups_near(const PlaceGrid& places, int past) const;
  Shares shares_of(const LayerGroup& group, int octave, const CellRegion& region,
                   std::vector<SourceIndex>& unusable) const;
  Field field(const LayerGroup& group, int octave, const CellRegion& region, std::vector<SourceIndex>& unusable) const;
  void add_group(const LayerGroup& group, const PlaceGrid& places, Mixture& mixture,
                 std::vector<SourceIndex>& unusable) const;
  void add_block(const LayerGroup& group, const std::vector<std::size_t>& indices, const std::vector<PostXY>& at,
                 Mixture& mixture, std::vector<SourceIndex>& unusable) const;

  const Catalogue& catalogue_;
  ReadPosts read_;
  HeightsBeneath beneath_;
  bool fall_through_;
  mutable Once grouped_;
  mutable std::unique_ptr<Found> found_;
};

}  // namespace selenograph::dem
