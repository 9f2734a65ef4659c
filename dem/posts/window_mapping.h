// Where the posts of a window lie in a file. In a geographic file columns and rows are separable.
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
#include "dem/posts/post_kernels.h"
#include "dem/posts/post_patch.h"
#include "dem/posts/post_window.h"

namespace selenograph::dem {

// Columns or rows of a window, and their positions in a file.
struct WindowPart {
  int first = 0, past_last = 0;
  std::vector<Place> places;
  bool on_posts = true;  // all are on posts
  bool in_one_piece() const {
    for (std::size_t i = 1; i < places.size(); ++i)
      if (places[i].post != places[i - 1].post + 1) return false;
    return !places.empty();
  }
};

// The range of places, along columns or rows, that are in a file or next to it, and the posts that they need including
// the kernel's margin.
struct PostRange {
  double low = 1e300, high = -1e300;
  void add(double v, double size) {
    if (v > -2 && v < size + 1) low = std::min(low, v), high = std::max(high, v);
  }
  bool empty() const { return low > high; }
  int first() const { return static_cast<int>(std::floor(low)) - 2; }
  int past_last() const { return static_cast<int>(std::ceil(high)) + 4; }

  // In a geographic file: the window's columns or rows well inside the range, if they are contiguous. Empty otherwise:
  // then each post must be examined.
  std::optional<WindowPart> well_inside(const std::vector<double>& all) const;
};

// A window's columns in a geographic file, shared by all of its strips.
class FileColumns {
 public:
  FileColumns(const RasterInfo& info, const PostWindow& window, bool pole);

  // Places of the part's columns in a row of the range, for interpolate_row().
  RowPlaces row_places() const {
    return {first_.data(), {weights_[0].data(), weights_[1].data(), weights_[2].data(), weights_[3].data()}};
  }

  std::vector<double> xs;
  PostRange range;
  std::optional<WindowPart> part;  // well inside

 private:
  std::vector<std::int32_t> first_;
  std::array<std::vector<double>, 4> weights_;
};

// Columns in all files that a window's strips are composed from.
class ColumnsOfFiles {
 public:
  std::shared_ptr<const FileColumns> of(const RasterInfo& info, int source, const PostWindow& window, bool pole) {
    const std::lock_guard lock(mutex_);
    std::shared_ptr<const FileColumns>& columns = known_[{source, window.lon0, pole}];
    if (!columns) columns = std::make_shared<const FileColumns>(info, window, pole);
    return columns;
  }

 private:
  std::mutex mutex_;
  std::map<std::tuple<int, std::int64_t, bool>, std::shared_ptr<const FileColumns>> known_;
};

// Where a window's posts lie in a file. In a geographic file columns and rows are separable.
class WindowMapping {
 public:
  WindowMapping(const RasterInfo& info, int source, const PostWindow& window, ColumnsOfFiles& files);

  int cols() const { return pole_ ? 1 : window_.cols; }
  bool pole() const { return pole_; }

  // Null if each post must be examined.
  const FileColumns* columns() const { return columns_ && columns_->part ? columns_.get() : nullptr; }
  std::optional<WindowPart> rows() const { return y_.well_inside(ys_); }

  PostXY at(int r, int c) const {
    if (columns_) return {columns_->xs[static_cast<std::size_t>(c)], ys_[static_cast<std::size_t>(r)]};
    return places_[static_cast<std::size_t>(r) * static_cast<std::size_t>(cols()) + static_cast<std::size_t>(c)];
  }

  // The part of the file that the window needs, with the kernel's margin; empty (w = 0) if they do not overlap.
  struct Box {
    int x0, y0, w, h;
  };
  Box box() const {
    if (x_.empty() || y_.empty()) return {0, 0, 0, 0};
    return {x_.first(), y_.first(), x_.past_last() - x_.first(), y_.past_last() - y_.first()};
  }
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
  std::shared_ptr<const FileColumns> columns_;  // for a geographic file
  std::vector<double> ys_;
  std::vector<PostXY> places_;  // for a file on a plane, each computed once
  PostRange x_, y_;
};

}  // namespace selenograph::dem
