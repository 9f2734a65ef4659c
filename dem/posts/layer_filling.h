// Fills a window with the valid posts of one layer.
#pragma once

#include "dem/grid/block.h"
#include "dem/posts/post_kernels.h"
#include "dem/posts/window_mapping.h"

namespace selenograph::dem {

// Output of one layer: fills the posts of a window that no finer layer has filled.
class LayerFilling {
 public:
  LayerFilling(int source, int window_cols, float* heights, SourceMark* sources)
      : mark_(static_cast<SourceMark>(source)),
        cols_(static_cast<std::size_t>(window_cols)),
        heights_(heights),
        sources_(sources) {}

  // Fills the missing posts among `n` of row `r`, from column `first` on. NaN and impossible heights stay missing.
  void add_row(int r, int first, const float* heights, int n) {
    const std::size_t at = index(r, first);
    const FillCount count = fill_missing(heights, n, mark_, heights_ + at, sources_ + at);
    filled_ += static_cast<std::size_t>(count.filled);
    impossible_ += static_cast<std::size_t>(count.impossible);
  }

  bool is_missing(int r, int c) const { return sources_[index(r, c)] == kNoSource; }
  // Fills one post, with `flag` (kFilledBit or 0) added to its source mark.
  void add_post(int r, int c, float h, SourceMark flag) {
    if (std::isnan(h)) return;
    if (h < kLowestRelief_m || h > kHighestRelief_m) {
      ++impossible_;
      return;
    }
    heights_[index(r, c)] = h;
    sources_[index(r, c)] = mark_ | flag;
    ++filled_;
  }

  // Number of posts filled, and of posts with heights that no lunar terrain has.
  std::size_t filled() const { return filled_; }
  std::size_t impossible() const { return impossible_; }

 private:
  std::size_t index(int r, int c) const { return static_cast<std::size_t>(r) * cols_ + static_cast<std::size_t>(c); }
  SourceMark mark_;
  std::size_t cols_, filled_ = 0, impossible_ = 0;
  float* heights_;
  SourceMark* sources_;
};

// Fills all rows from a geographic file, whose rows and columns are separable: a row of the window consists of posts of
// one row of the file, or is interpolated from four such rows with the row's weights.
void fill_rows(const PostPatch& patch, const FileColumns& all_columns, const AxisSpan& rows, LayerFilling& filling);

}  // namespace selenograph::dem
