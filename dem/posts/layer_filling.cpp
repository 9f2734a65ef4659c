#include "dem/posts/layer_filling.h"

#include <array>
#include <limits>
#include <utility>
#include <vector>

#include "dem/posts/cubic.h"
#include "dem/posts/tile_of_voids.h"

namespace selenograph::dem {

namespace {

// Caches a patch's rows, interpolated along the row at the window's columns. Consecutive rows of the window use the
// same four rows of the file.
class InterpolatedRows {
 public:
  InterpolatedRows(const PostPatch& patch, const FileColumns& columns) : patch_(patch), columns_(columns) {
    rows_.fill(std::numeric_limits<int>::min());
  }

  const double* at(int y) {
    const auto slot = static_cast<std::size_t>(y & 3);
    if (std::exchange(rows_[slot], y) != y) {
      values_[slot].resize(columns_.span->positions.size());
      interpolate_row(&patch_.posts[patch_.index(patch_.x0, y)], patch_.w, columns_.row_taps(),
                      static_cast<int>(values_[slot].size()), values_[slot].data());
    }
    return values_[slot].data();
  }

 private:
  const PostPatch& patch_;
  const FileColumns& columns_;
  std::array<int, 4> rows_;  // row number of each cached row, by that number modulo 4
  std::array<UninitialisedVector<double>, 4> values_;
};

}  // namespace

void fill_rows(const PostPatch& patch, const FileColumns& all_columns, const AxisSpan& rows, LayerFilling& filling) {
  const AxisSpan& columns = *all_columns.span;
  const int n = columns.past_last - columns.first;
  const auto count = static_cast<std::size_t>(n);
  const bool copied = columns.on_posts && rows.on_posts;
  const bool is_contiguous = columns.is_contiguous();
  std::vector<float> heights(count);
  InterpolatedRows along(patch, all_columns);
  for (int r = rows.first; r < rows.past_last; ++r) {
    const PostPosition& y = rows.positions[static_cast<std::size_t>(r - rows.first)];
    // Copy without a temporary where the window's columns are consecutive posts of the file.
    if (copied && is_contiguous) {
      filling.add_row(r, columns.first, &patch.posts[patch.index(columns.positions.front().post, y.post)], n);
      continue;
    }
    if (copied) {
      for (std::size_t i = 0; i < count; ++i) heights[i] = patch.at(columns.positions[i].post, y.post);
    } else {
      const int first = y.post - 1;
      add_four_rows({along.at(first), along.at(first + 1), along.at(first + 2), along.at(first + 3)},
                    cubic_weights(y.fraction), n, heights.data());
      if (any_void(heights.data(), n))
        for (std::size_t i = 0; i < count; ++i)
          if (std::isnan(heights[i])) heights[i] = interpolate(patch, columns.positions[i], y);
    }
    filling.add_row(r, columns.first, heights.data(), n);
  }
}

}  // namespace selenograph::dem
