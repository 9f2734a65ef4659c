// Cells of a sheet, per octave, in which the coarser layer shows (layer_edges.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <tuple>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/posts/layer_groups.h"
#include "dem/posts/valid_posts.h"

namespace selenograph::dem {

// Cells of one octave.
struct CellRegion {
  std::int64_t x0, y0, x1, y1;
  std::size_t columns() const { return static_cast<std::size_t>(x1 - x0); }
  std::size_t rows() const { return static_cast<std::size_t>(y1 - y0); }
  std::size_t index(std::int64_t x, std::int64_t y) const {
    return static_cast<std::size_t>(y - y0) * columns() + static_cast<std::size_t>(x - x0);
  }
};

struct OpenCells {
  CellRegion region;
  bool any = false;
  std::vector<char> open{};  // empty if there are none
};

// Finds open cells: none of 16 posts of a cell, evenly spread, is valid, and a coarser layer has one. Thread-safe:
// const functions may be called concurrently.
class CellTiles {
 public:
  // The arguments must outlive this object.
  CellTiles(const Catalogue& catalogue, const LayerGroups& groups, const ValidPosts& posts);
  ~CellTiles();

  // Unreadable files are appended to `unusable`.
  OpenCells within(int sheet, int octave, const CellRegion& region, std::vector<SourceIndex>& unusable) const;

 private:
  using Key = std::tuple<int, int, std::int64_t, std::int64_t>;  // sheet, octave, column, row
  struct Tile;
  struct Samples;
  std::shared_ptr<const Tile> tile(const Key& key) const;
  std::shared_ptr<const Tile> make_tile(const Key& key) const;
  std::shared_ptr<const Tile> joined_tile(const Key& key) const;
  void add_valid(int source, const Samples& samples, std::vector<char>& valid,
                 std::vector<SourceIndex>& unusable) const;
  std::vector<char> closed_cells(const Samples& samples, const std::vector<int>& touching,
                                 std::vector<SourceIndex>& unusable) const;
  void open_over(const Samples& samples, const std::vector<int>& touching, std::vector<char> closed, Tile& tile) const;

  const Catalogue& catalogue_;
  const LayerGroups& groups_;
  const ValidPosts& posts_;
  mutable std::mutex mutex_;
  mutable std::map<Key, std::shared_ptr<const Tile>> tiles_;
};

}  // namespace selenograph::dem
