// Bends coarser layers until they meet the posts of finer ones.
//
// Every valid post of a finer layer is the surface, unchanged. In a band around these posts, and in holes between them,
// the coarser surface b becomes b + c: c is the step from b to the finer posts along their border, carried outward, and
// fades over the band:
//
//  plan:                                                section:
//     . . . . . . . . . . .  F  finer posts                                     ___---
//     . + + + + + + + + + .     unchanged                finer      o---o---o   ___-----   b + c joins b
//     . + F F F F F F F + .                              posts              ---           '
//     . + F F + + F F F + .  +  b + c: coarser           c              0           |||...     0
//     . + F F F F F F F + .     surface, bent            coarser, b     - - - - - - - - ------'---------
//     . + + + + + + + + + .                                                     |<--- band --->|
//     . . . . . . . . . . .  .  b unchanged
//
// Layers are added from coarse to fine: the step of a layer is measured from the coarser ones as already bent. Rasters
// of equal resolution are one layer and do not bend each other.
//
// c is built octave by octave (border_cells.h). In each octave, the steps of border cells are averaged with weights
// that fall with the fourth power of the distance. A finer octave replaces the coarser one within one cell of the
// border, and fades out over the next three. Coarser octaves are refined by subdivision of quadratic B-splines (Chaikin
// 1974). At a border post c is that post's own step. c is a function of the position only: the same from any window,
// level, tile and number of threads.
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

// Geographic positions in rows and columns, each with the source of the surface there.
struct PositionGrid {
  int rows = 0, columns = 0;
  std::function<Geographic(int row, int column)> position;
  std::span<const SourceMark> sources;  // row by row; kNoSource: no data
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(columns) + static_cast<std::size_t>(c);
  }
};

// Smallest box of latitudes and longitudes around positions.
struct PositionBox {
  double south_deg = 90, north_deg = -90;
  double west_deg = 0, east_deg = 0;  // east >= west
  void add(const Geographic& position);
  bool empty() const { return south_deg > north_deg; }
};

// Bends at the positions of a grid, in its order.
struct Bends {
  std::vector<float> added_m;           // c, m, per position; empty: nothing is bent
  std::vector<float> finer_distance_m;  // distance to finer layers, m; infinite beyond the bands
  std::vector<SourceIndex> unusable{};
};

// Computes the bends of all groups. Thread-safe: const functions may be called concurrently.
class LayerBends {
 public:
  // Takes the arguments of BorderCells.
  LayerBends(const Catalogue& catalogue, ReadPosts read, HeightsBeneath beneath, bool fall_through);
  ~LayerBends();

  // Returns the width of the band outside the file's group, in posts of the file; 0: nothing is bent. Reads no posts.
  double band_posts(int source) const;
  // Returns the widest band of any group, degrees of latitude.
  double widest_band_deg() const { return grouping().groups.widest_band_deg; }
  // Returns the files of the group that contains a file, ascending.
  const std::vector<int>& group_of(int source) const;

  // Returns the bends at the grid's positions: what is added to heights of coarser sources so that they meet finer
  // layers. Only the first `past_file` files of the catalogue are considered.
  Bends bends_at(const PositionGrid& grid, int past_file) const;

  // Returns the border posts of a file's group: about one for each half post of the coarser layer along the border,
  // some 256 for a small group, at most `max_posts`, evenly spread. Empty for groups that are too large.
  std::vector<BorderPost> border_posts(int source, std::size_t max_posts) const;

 private:
  struct Field;
  struct OctaveShares;
  class BendMixture;
  struct Grouping {  // Groups and their border cells, created on first use.
    Grouping(const Catalogue& catalogue, const ReadPosts& read, const HeightsBeneath& beneath, bool fall_through)
        : groups(find_groups(catalogue)), cells(catalogue, groups, read, beneath, fall_through) {}
    LayerGroups groups;
    BorderCells cells;
  };
  const Grouping& grouping() const;
  // Returns whether a post comes from a coarser layer than the one that begins with file `layer_begin`.
  bool can_bend(SourceMark mark, int layer_begin) const {
    const SourceIndex source = source_of(mark);
    return source != kNoSource && catalogue_.layer_begin(static_cast<int>(source)) < layer_begin;
  }
  std::vector<const LayerGroup*> groups_near(const PositionGrid& grid, int past_file) const;
  OctaveShares compute_shares(const LayerGroup& group, int octave, const CellRegion& region,
                              std::vector<SourceIndex>& unusable) const;
  Field compute_field(const LayerGroup& group, int octave, const CellRegion& region,
                      std::vector<SourceIndex>& unusable) const;
  void add_group(const LayerGroup& group, const PositionGrid& grid, BendMixture& mixture,
                 std::vector<SourceIndex>& unusable) const;
  void add_block(const LayerGroup& group, const std::vector<std::size_t>& indices, const std::vector<PostXY>& positions,
                 BendMixture& mixture, std::vector<SourceIndex>& unusable) const;

  const Catalogue& catalogue_;
  ReadPosts read_;
  HeightsBeneath beneath_;
  bool fall_through_;
  mutable Once grouped_;
  mutable std::unique_ptr<Grouping> grouping_;
};

}  // namespace selenograph::dem
