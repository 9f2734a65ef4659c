#include "dem/posts/layer_filling.h"

#include <array>
#include <limits>
#include <utility>
#include <vector>

#include "dem/posts/cubic.h"
#include "dem/posts/tile_of_voids.h"

namespace selenograph::dem {

namespace {

// Rows of a patch, interpolated at places along them. Each is wanted for a few rows of the window that follow each
// other.
class AlongRows {
 public:
  AlongRows(const PostPatch& patch, const FileColumns& columns) : patch_(patch), columns_(columns) {
    rows_.fill(std::numeric_limits<int>::min());
  }

  const double* at(int y) {
    const auto slot = static_cast<std::size_t>(y & 3);
    if (std::exchange(rows_[slot], y) != y) {
      values_[slot].resize(columns_.part->places.size());
      interpolate_row(&patch_.posts[patch_.index(patch_.x0, y)], patch_.w, columns_.row_places(),
                      static_cast<int>(values_[slot].size()), values_[slot].data());
    }
    return values_[slot].data();
  }

 private:
  const PostPatch& patch_;
  const FileColumns& columns_;
  std::array<int, 4> rows_;  // whose values are here, by their number modulo 4
  std::array<UninitialisedVector<double>, 4> values_;
};

}  // namespace

void fill_rows(const PostPatch& patch, const FileColumns& all_columns, const WindowPart& rows, LayerFilling& filling) {
  const WindowPart& columns = *all_columns.part;
  const int n = columns.past_last - columns.first;
  const auto count = static_cast<std::size_t>(n);
  const bool copied = columns.on_posts && rows.on_posts;
  const bool in_one_piece = columns.in_one_piece();
  std::vector<float> heights(count);
  AlongRows along(patch, all_columns);
  for (int r = rows.first; r < rows.past_last; ++r) {
    const Place& y = rows.places[static_cast<std::size_t>(r - rows.first)];
    if (copied && in_one_piece) {
      filling.row(r, columns.first, &patch.posts[patch.index(columns.places.front().post, y.post)], n);
      continue;
    }
    if (copied) {
      for (std::size_t i = 0; i < count; ++i) heights[i] = patch.at(columns.places[i].post, y.post);
    } else {
      const int first = y.post - 1;
      add_four_rows({along.at(first), along.at(first + 1), along.at(first + 2), along.at(first + 3)},
                    cubic_weights(y.fraction), n, heights.data());
      if (any_void(heights.data(), n))
        for (std::size_t i = 0; i < count; ++i)
          if (std::isnan(heights[i])) heights[i] = interpolate(patch, columns.places[i], y);
    }
    filling.row(r, columns.first, heights.data(), n);
  }
}

}  // namespace selenograph::dem
