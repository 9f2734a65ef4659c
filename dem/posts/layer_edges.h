// Blending of layers of different resolution: the share of the coarser layer near the border of a finer one.
//
// Rasters of equal resolution are one layer and are not blended with each other. Rasters of a layer that lie on one
// grid and touch are a group, which has one band. Next to places where a group has no post and a coarser layer has one,
// the share of the coarser layer falls smoothly from 1 to 0:
//  - over the band, next to gaps at least about a tenth of the band wide: the outline, large holes;
//  - over about two to seven times the width of a smaller hole. A hole of one post must not cost the posts of a whole
//    band around it, and smaller holes are bridged more easily.
// Without a coarser layer below there is no blending: an outermost border stays unchanged.
//
// The shares are computed on the group's own posts, octave by octave. Octave j has cells of 2^j x 2^j posts; a cell is
// open when none of 16 evenly spread posts is valid and a coarser layer covers it. The share of a cell follows from the
// distance to the nearest open cell of the octave. Shares of octaves are combined as 1 - (1 - a)(1 - b) while they are
// refined to the posts by subdivision of quadratic B-splines (Chaikin 1974): the result is C1 everywhere, exactly 0
// where no open cell is near, and a function of the place only, independent of the window.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/posts/layer_groups.h"
#include "dem/posts/open_cells.h"
#include "dem/posts/valid_posts.h"
#include "dem/support/once.h"

namespace selenograph::dem {

// Thread-safe: const functions may be called concurrently.
class LayerEdges {
 public:
  // With `fall_through` an unreadable file counts as if none of its posts were valid, and is reported; otherwise
  // DataError is thrown.
  LayerEdges(const Catalogue& catalogue, ValidPosts::Read read, bool fall_through);
  ~LayerEdges();

  // Whether a file overlaps a coarser layer. Fast: reads no posts.
  bool meets(int source) const;
  // Width of its band in its own posts; 0: no band. At most half of the largest distance from the group's border, so
  // that a small layer keeps its own posts in its middle.
  double band_posts(int source) const;

  // Shares of the coarser layers around posts (x0, y0) .. (x0 + w - 1, y0 + h - 1) of a file.
  class Shares {
   public:
    // Share at a place, in post coordinates.
    double at(double x, double y) const;

   private:
    friend class LayerEdges;
    int octave_ = 0;                              // of the control points; 0: one per post of the file
    std::int64_t shift_x_ = 0, shift_y_ = 0;      // otherwise: position of the file's first post in the sheet
    std::int64_t x0_ = 0, y0_ = 0, columns_ = 0;  // of the control points
    std::vector<float> points_;
  };
  // Empty: 0 everywhere. Unreadable files are appended to `unusable`.
  std::optional<Shares> shares(int source, int x0, int y0, int w, int h, std::vector<SourceIndex>& unusable) const;
  // Shares from the outline and large holes only, in the coarsest octave, for any number of posts.
  std::optional<Shares> shares_of_outline(int source, int x0, int y0, int w, int h) const;

  // A valid post next to the coarser layer.
  struct BorderPost {
    int source, x, y;
  };
  // Border posts of a file's group: about one for each half post of the coarser layer along the border, some 256 for a
  // small group, at most `most`, evenly spread. Empty for groups that are too large.
  std::vector<BorderPost> border(int source, std::size_t most) const;
  // Files of its group, ascending.
  const std::vector<int>& group_of(int source) const;

 private:
  enum class Octaves { all, coarsest };
  std::optional<Shares> shares_of(int source, int x0, int y0, int w, int h, Octaves octaves,
                                  std::vector<SourceIndex>& unusable) const;
  struct Found {  // created on first use
    Found(const Catalogue& catalogue, const ValidPosts& posts)
        : groups(find_groups(catalogue)), cells(catalogue, groups, posts) {}
    LayerGroups groups;
    CellTiles cells;
  };
  const Found& found() const;
  const LayerGroups& groups() const { return found().groups; }
  const CellTiles& cells() const { return found().cells; }
  const LayerGroup& settled(int source) const;
  void settle(LayerGroup& group) const;
  double half_width_posts(const LayerGroup& group, int octave) const;
  std::optional<BorderPost> nearest_valid(const LayerGroup& group, const CellRegion& cell, double x, double y,
                                          std::vector<char>& valid) const;

  const Catalogue& catalogue_;
  ValidPosts posts_;
  mutable std::vector<std::atomic<signed char>> meets_;  // -1: not yet known
  mutable Once grouped_;
  mutable std::unique_ptr<Found> found_;
};

}  // namespace selenograph::dem
