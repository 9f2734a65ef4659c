// Fills a window with the valid posts of one file: WindowMapping finds the positions of the window's posts in the file,
// LayerFilling stores their heights. In a geographic file columns and rows are separable: a column's position does not
// depend on the row.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <tuple>
#include <vector>

#include "dem/files/raster_info.h"
#include "dem/grid/block.h"
#include "dem/posts/post_kernels.h"
#include "dem/posts/post_patch.h"
#include "dem/posts/post_window.h"

namespace selenograph::dem {

// Consecutive columns or rows of a window, and their positions in a file.
struct AxisSpan {
  int first = 0, past_last = 0;
  std::vector<PostPosition> positions;
  bool on_posts = true;  // all positions are on posts
  // Returns true if the positions are consecutive posts, which can be copied as one array.
  bool is_contiguous() const {
    for (std::size_t i = 1; i < positions.size(); ++i)
      if (positions[i].post != positions[i - 1].post + 1) return false;
    return !positions.empty();
  }
};

// Range of the positions, along one axis of a file, of those columns or rows of a window that lie in the file or next
// to it. Also gives the posts that these need, with the kernel's margin.
struct PostRange {
  double low = 1e300, high = -1e300;
  // Adds a position unless it is too far outside a file with `size` posts along the axis to use any of them.
  void add(double v, double size) {
    if (!(v > -2 && v < size + 1)) return;
    low = std::min(low, v);
    high = std::max(high, v);
  }
  bool empty() const { return low > high; }
  int first() const { return static_cast<int>(std::floor(low)) - 2; }
  int past_last() const { return static_cast<int>(std::ceil(high)) + 4; }

  // Returns the window's columns or rows (of a geographic file) whose kernels lie inside the range, if they are
  // contiguous. Empty otherwise: then each post must be examined.
  std::optional<AxisSpan> well_inside(const std::vector<double>& window_positions) const;
};

// Columns of a window in a geographic file, shared by all of its strips.
class FileColumns {
 public:
  FileColumns(const RasterInfo& info, const PostWindow& window, bool pole);

  // Returns the taps of the span's columns, counted from the range's first column, for interpolate_row().
  RowTaps row_taps() const {
    return {first_.data(), {weights_[0].data(), weights_[1].data(), weights_[2].data(), weights_[3].data()}};
  }

  std::vector<double> xs;  // column in the file, per column of the window
  PostRange range;
  std::optional<AxisSpan> span;  // columns well inside the file

 private:
  std::vector<std::int32_t> first_;             // RowTaps::first
  std::array<std::vector<double>, 4> weights_;  // RowTaps::weights
};

// Cache of the columns, shared by a window's strips: one entry per file, first longitude (rows beyond a pole begin on
// the opposite meridian), and kind of row (a pole has one column).
class ColumnsOfFiles {
 public:
  std::shared_ptr<const FileColumns> find_or_create(const RasterInfo& info, int source, const PostWindow& window,
                                                    bool pole) {
    const std::lock_guard lock(mutex_);
    std::shared_ptr<const FileColumns>& columns = columns_[{source, window.lon0, pole}];
    if (!columns) columns = std::make_shared<const FileColumns>(info, window, pole);
    return columns;
  }

 private:
  std::mutex mutex_;
  std::map<std::tuple<int, std::int64_t, bool>, std::shared_ptr<const FileColumns>> columns_;
};

// Position of each post of a window in one file.
class WindowMapping {
 public:
  WindowMapping(const RasterInfo& info, int source, const PostWindow& window, ColumnsOfFiles& files);

  int cols() const { return pole_ ? 1 : window_.cols; }
  bool pole() const { return pole_; }

  // Returns the columns well inside the file; null if each post must be examined.
  const FileColumns* columns() const { return columns_ && columns_->span ? columns_.get() : nullptr; }
  std::optional<AxisSpan> rows() const { return y_.well_inside(ys_); }

  // Returns the position in the file of the post in row `r` and column `c` of the window.
  PostXY at(int r, int c) const {
    if (columns_) return {columns_->xs[static_cast<std::size_t>(c)], ys_[static_cast<std::size_t>(r)]};
    return positions_[static_cast<std::size_t>(r) * static_cast<std::size_t>(cols()) + static_cast<std::size_t>(c)];
  }

  // Rectangle of the file's posts that the window needs, with the kernel's margin; empty (w = 0) if they do not
  // overlap.
  struct Box {
    int x0, y0, w, h;
  };
  Box box() const {
    if (x_.empty() || y_.empty()) return {0, 0, 0, 0};
    return {x_.first(), y_.first(), x_.past_last() - x_.first(), y_.past_last() - y_.first()};
  }
  // Returns a patch of that rectangle, whose posts are still to be read.
  PostPatch patch() const {
    const Box b = box();
    PostPatch patch{b.x0, b.y0, b.w, b.h, {}};
    patch.posts.resize(static_cast<std::size_t>(patch.w) * static_cast<std::size_t>(patch.h));
    return patch;
  }

 private:
  const RasterInfo& info_;
  const PostWindow& window_;
  bool pole_;
  std::shared_ptr<const FileColumns> columns_;  // null for a file on a plane
  std::vector<double> ys_;                      // row in the file, per row of the window, for a geographic file
  std::vector<PostXY> positions_;               // per post, for a file on a plane
  PostRange x_, y_;
};

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
    filled_ += static_cast<std::size_t>(fill_missing(heights, n, mark_, heights_ + at, sources_ + at));
  }

  bool is_missing(int r, int c) const { return sources_[index(r, c)] == kNoSource; }
  // Fills one post, with `flag` (kFilledBit or 0) added to its source mark.
  void add_post(int r, int c, float h, SourceMark flag) {
    if (!(h >= kLowestRelief_m && h <= kHighestRelief_m)) return;
    heights_[index(r, c)] = h;
    sources_[index(r, c)] = mark_ | flag;
    ++filled_;
  }

  std::size_t filled() const { return filled_; }

 private:
  std::size_t index(int r, int c) const { return static_cast<std::size_t>(r) * cols_ + static_cast<std::size_t>(c); }
  SourceMark mark_;
  std::size_t cols_, filled_ = 0;
  float* heights_;
  SourceMark* sources_;
};

// Fills all rows from a geographic file, whose rows and columns are separable: a row of the window consists of posts of
// one row of the file, or is interpolated from four such rows with the row's weights.
void fill_rows(const PostPatch& patch, const FileColumns& all_columns, const AxisSpan& rows, LayerFilling& filling);

}  // namespace selenograph::dem
