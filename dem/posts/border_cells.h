// Posts along the border of a finer layer, with their steps above the coarser layers, gathered in cells.
//
// Octave j of a sheet has cells of 2^j x 2^j posts, of which up to 4 x 4, evenly spread, are samples:
//
//      v v v .        v  valid sample of the layer          b  border sample: valid, one of its four neighbours is not
//      v v b .        .  no valid post: a coarser layer, or nothing, shows
//      v b . .
//
// A border cell holds the mean step (own height minus that of the coarser layers) of its border samples. Samples lie at
// multiples of their stride in the sheet, so that a cell does not depend on the requested region.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <span>
#include <tuple>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/posts/layer_groups.h"

namespace selenograph::dem {

// Rectangle of cells of one octave; x1 and y1 are exclusive.
struct CellRegion {
  std::int64_t x0, y0, x1, y1;
  std::size_t columns() const { return static_cast<std::size_t>(x1 - x0); }
  std::size_t rows() const { return static_cast<std::size_t>(y1 - y0); }
  std::size_t index(std::int64_t x, std::int64_t y) const {
    return static_cast<std::size_t>(y - y0) * columns() + static_cast<std::size_t>(x - x0);
  }
};

// Cell with at least one border sample; x and y count cells of its octave.
struct BorderCell {
  std::int64_t x, y;
  float step_m;   // mean over the cell's border samples
  float samples;  // number of border samples
};

// Post of a file on the border of its layer.
struct BorderPost {
  int source, x, y;     // file, column and row in the file
  float step_m;         // height above the coarser layers
  SourceIndex beneath;  // file that the surface would show without this layer
};

// Writes heights of a catalogue's first `files` files at geographic positions, m (NaN: no data), and the files that
// they come from. Unreadable files are appended to `unusable`.
using HeightsBeneath = std::function<void(std::span<const Geographic> positions, int files, float* heights_m,
                                          SourceIndex* sources, std::vector<SourceIndex>& unusable)>;
// Reads posts of one file as PostSource::read() does.
using ReadPosts = std::function<void(int source, int x0, int y0, int w, int h, float* heights_m)>;

// Computes and caches border cells, tile by tile. Thread-safe: const functions may be called concurrently.
class BorderCells {
 public:
  // With `fall_through` an unreadable file counts as if none of its posts were valid, and is reported; otherwise
  // DataError is thrown. All references must outlive this object.
  BorderCells(const Catalogue& catalogue, const LayerGroups& groups, ReadPosts read, HeightsBeneath beneath,
              bool fall_through);
  ~BorderCells();

  // Returns the border cells of a region, in an order that does not depend on the region. Unreadable files are appended
  // to `unusable`.
  std::vector<BorderCell> cells_in(int sheet, int octave, const CellRegion& region,
                                   std::vector<SourceIndex>& unusable) const;
  // Returns the border samples of a region's cells.
  std::vector<BorderPost> posts_in(int sheet, int octave, const CellRegion& region) const;

 private:
  using Key = std::tuple<int, int, std::int64_t, std::int64_t>;  // sheet, octave, column, row
  struct Tile;
  struct SampleGrid;
  struct BorderSample;
  std::shared_ptr<const Tile> tile(const Key& key) const;
  std::shared_ptr<const Tile> make_tile(const Key& key) const;
  std::vector<BorderSample> border_samples(const Key& key, std::vector<SourceIndex>& unusable) const;
  void read_samples(int source, SampleGrid& samples, std::vector<SourceIndex>& unusable) const;
  bool read_or_report(int source, std::int64_t x0, std::int64_t y0, int w, int h, std::vector<float>& heights_m,
                      std::vector<SourceIndex>& unusable) const;

  const Catalogue& catalogue_;
  const LayerGroups& groups_;
  ReadPosts read_;
  HeightsBeneath beneath_;
  bool fall_through_;
  mutable std::mutex mutex_;
  mutable std::map<Key, std::shared_ptr<const Tile>> tiles_;
  mutable std::size_t cells_held_ = 0;
};

}  // namespace selenograph::dem
