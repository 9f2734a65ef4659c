// Composes the finest posts over a window of the lattice from all layers that cover it.
//
// The finest valid layer wins, unchanged; no-data is filled from the next coarser layer, which is bent to meet the
// finer one along its border (layer_bends.h). Remaining gaps between valid posts are interpolated and flagged. A
// product whose posts lie on the lattice is copied; any other is interpolated. README.md draws the steps.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <span>
#include <string>
#include <vector>

#include "dem/base/stop_token.h"
#include "dem/catalogue/catalogue.h"
#include "dem/grid/block.h"
#include "dem/posts/layer_bends.h"
#include "dem/posts/level_borders.h"
#include "dem/posts/post_window.h"

namespace selenograph::dem {

class RasterPool;
struct PostPatch;

// Reads and composes posts. Thread-safe: a pool lends each open file to one thread at a time.
class PostSource {
 public:
  // With `fall_through` the next coarser layer replaces an unusable file, and `warn(file, text)` is called; without it
  // such a file throws DataError. `warn` is also called for heights outside the range of lunar relief, which count as
  // voids. A SystemFault is always thrown.
  using Warn = std::function<void(const std::string& file, const std::string& text)>;
  PostSource(const Catalogue& catalogue, bool fall_through, Warn warn);
  ~PostSource();

  // Reads the rectangle of w x h posts whose first one is column x0, row y0 of the file `source`: heights in metres row
  // by row, with the layer's offset, NaN for no data; outside the file as Raster::read().
  void read(int source, int x0, int y0, int w, int h, float* heights_m) const;

  // Returns the number of files in the catalogue.
  int files() const { return static_cast<int>(catalogue_.rasters().size()); }
  // Composes the layers without filling voids. With `files`, only the catalogue's first `files` files, the coarser
  // layers, contribute posts; they are still bent to meet the finer ones.
  Posts compose(const PostWindow& window, const StopToken& stop = {}) const;
  Posts compose(const PostWindow& window, int files, const StopToken& stop) const;
  // Composes all layers and fills voids, into the memory of `grid`.
  void compose_filled(const PostWindow& window, PostGridRows& grid, const StopToken& stop) const;
  // Fills voids in place. Needs kFillReach posts of context around the result.
  static void fill_voids(const PostWindow& window, Posts& posts, const StopToken& stop = {});

  // Return the borders of layers and of levels.
  const LayerBends& bends() const { return bends_; }
  const LevelBorders& borders() const { return borders_; }

 private:
  void close_gaps(int source, PostPatch& patch) const;
  // Steps of compose(). `first_post`: index of the zone's or window's first post in the strip's arrays.
  struct Strip;
  template <typename ComposeRows>
  void for_strips(const PostWindow& window, const StopToken& stop, ComposeRows&& compose_rows) const;
  void compose_strip(const PostWindow& window, const Strip& strip, const StopToken& stop) const;
  void compose_zone(const PostWindow& zone, std::size_t first_post, const Strip& strip, const StopToken& stop) const;
  void join_levels_in(const PostWindow& zone, std::size_t first_post, const Strip& strip,
                      std::span<const float> finer_distance_m, const StopToken& stop) const;
  std::vector<float> bend(const PostWindow& zone, std::size_t first_post, const Strip& strip) const;
  void heights_at(std::span<const Geographic> positions, int files, float* heights_m, SourceIndex* sources,
                  std::vector<SourceIndex>& unusable) const;
  void add_heights(int source, std::span<const Geographic> positions, float* heights_m, SourceIndex* sources,
                   std::vector<SourceIndex>& unusable) const;
  // Interpolation needs posts all around a position; extrapolation reaches up to a post beyond the outermost posts.
  enum class Sampling { interpolate, extrapolate };
  std::size_t add_layer(int source, const PostWindow& window, std::size_t first_post, Sampling sampling,
                        const Strip& strip) const;
  const Catalogue& catalogue_;
  bool fall_through_;
  Warn warn_;
  std::unique_ptr<RasterPool> pool_;
  mutable std::mutex replaced_mutex_;  // guards Posts::replaced, which strips on several threads extend
  double post_deg_ = 0;                // widest post spacing of any file, degrees
  LayerBends bends_;
  LevelBorders borders_;
};

}  // namespace selenograph::dem
