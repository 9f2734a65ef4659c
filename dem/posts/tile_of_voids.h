// Fills voids between valid posts, tile by tile.
//
//             v north        Each void post becomes the mean of the valid posts nearest to it in its row and in its
//             .              column, weighted by 1 / distance. A row or column counts only if it has valid posts
//    v . . .  ?  . v         on both sides within kFillReach posts.
//    west     .    east
//             v south        v  valid post    ?  void to fill    .  other voids
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "dem/base/parallel.h"
#include "dem/base/stop_token.h"
#include "dem/posts/post_window.h"

namespace selenograph::dem {

// Returns true if a row has a void.
inline bool any_void(const float* h, int n) {
  int any_nan = 0;  // int rather than bool, so that the compiler vectorises the loop
  for (int i = 0; i < n; ++i) any_nan |= h[i] != h[i];
  return any_nan != 0;
}

// Returns true if all posts of a row are voids.
inline bool all_void(const float* h, int n) {
  int any_valid = 0;
  for (int i = 0; i < n; ++i) any_valid |= h[i] == h[i];
  return any_valid == 0;
}

// Result for one void: index among the window's heights, interpolated height and source of the nearest valid post.
struct FilledPost {
  std::size_t index;
  float height_m;
  SourceMark source;  // with kFilledBit
};

// Voids of one tile of a window: at most kSide x kSide posts from (`row`, `col`) on.
class TileOfVoids {
 public:
  static constexpr int kSide = 64;

  TileOfVoids(const PostWindow& window, const float* heights, int row, int col)
      : window_(window),
        heights_(heights),
        r0_(row),
        r1_(std::min(row + kSide, window.rows)),
        c0_(col),
        c1_(std::min(col + kSide, window.cols)) {}

  // Returns the tile's voids that can be filled, row by row. `mark(index)` returns the source mark of a valid post.
  template <typename Mark>
  std::vector<FilledPost> filled(const Mark& mark) const {
    if (!has_voids() || !has_valid_nearby()) return {};
    // Sweep the tile from each of the four sides, from kFillReach posts outside it on.
    Distances west{}, east{}, south{}, north{};
    for (int r = r0_; r < r1_; ++r) {
      std::uint8_t since = 0;  // posts since the row's last valid one; 0: more than kFillReach
      for (int c = std::max(c0_ - kFillReach, 0); c < c1_; ++c) advance(r, c, since, west);
      since = 0;
      for (int c = std::min(c1_ + kFillReach, window_.cols) - 1; c >= c0_; --c) advance(r, c, since, east);
    }
    std::array<std::uint8_t, kSide> below{}, above{};  // the same per column
    for (int r = std::max(r0_ - kFillReach, 0); r < r1_; ++r)
      for (int c = c0_; c < c1_; ++c) advance(r, c, below[static_cast<std::size_t>(c - c0_)], south);
    for (int r = std::min(r1_ + kFillReach, window_.rows) - 1; r >= r0_; --r)
      for (int c = c0_; c < c1_; ++c) advance(r, c, above[static_cast<std::size_t>(c - c0_)], north);

    std::vector<FilledPost> found;
    for (int r = r0_; r < r1_; ++r)
      for (int c = c0_; c < c1_; ++c) {
        const std::size_t k = local(r, c);
        const auto void_index = static_cast<std::ptrdiff_t>(index(r, c));
        if (!std::isnan(heights_[static_cast<std::size_t>(void_index)])) continue;
        double weighted_sum_m = 0, weight_sum = 0;
        int nearest = kFillReach + 1;
        SourceMark source = kNoSource;
        // Adds the valid posts on both sides of the void along one axis, whose adjacent posts are `stride` elements
        // apart. `before`, `after`: their distances in posts; 0: none.
        const auto add_axis = [&](int before, int after, std::ptrdiff_t stride) {
          if (before == 0 || after == 0) return;
          for (const auto& [distance, valid_index] :
               {std::pair{before, void_index - before * stride}, {after, void_index + after * stride}}) {
            const auto valid = static_cast<std::size_t>(valid_index);
            weighted_sum_m += static_cast<double>(heights_[valid]) / distance;
            weight_sum += 1.0 / distance;
            if (distance < nearest) {
              nearest = distance;
              source = mark(valid);
            }
          }
        };
        add_axis(west[k], east[k], 1);
        add_axis(south[k], north[k], window_.cols);
        if (weight_sum > 0)
          found.push_back({static_cast<std::size_t>(void_index), static_cast<float>(weighted_sum_m / weight_sum),
                           source | kFilledBit});
      }
    return found;
  }

 private:
  // Distance, per post of the tile, of the nearest valid post in one direction; 0: none within kFillReach.
  using Distances = std::array<std::uint8_t, kSide * kSide>;
  static_assert(kFillReach < 256);

  bool has_voids() const {
    for (int r = r0_; r < r1_; ++r)
      if (any_void(&heights_[index(r, c0_)], c1_ - c0_)) return true;
    return false;
  }

  bool has_valid_nearby() const {
    const int west = std::max(c0_ - kFillReach, 0), east = std::min(c1_ + kFillReach, window_.cols);
    for (int r = std::max(r0_ - kFillReach, 0); r < std::min(r1_ + kFillReach, window_.rows); ++r)
      if (!all_void(&heights_[index(r, west)], east - west)) return true;
    return false;
  }

  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(window_.cols) + static_cast<std::size_t>(c);
  }
  std::size_t local(int r, int c) const { return static_cast<std::size_t>((r - r0_) * kSide + c - c0_); }

  // Advances one post along a row or column: `since` counts posts since the last valid one, and void posts of the tile
  // record it as their distance.
  void advance(int r, int c, std::uint8_t& since, Distances& distances) const {
    if (!std::isnan(heights_[index(r, c)])) {
      since = 1;
      return;
    }
    if (r >= r0_ && r < r1_ && c >= c0_ && c < c1_) distances[local(r, c)] = since;
    since = since == 0 || since == kFillReach ? 0 : static_cast<std::uint8_t>(since + 1);
  }

  const PostWindow& window_;
  const float* heights_;
  int r0_, r1_, c0_, c1_;
};

// Calls use(post), row by row, for each void that can be filled. `has_voids`: per row. All tiles are read, in parallel,
// before the first post is written: a tile reads posts of its neighbours.
template <typename Mark, typename Use>
void for_each_filled(const PostWindow& window, const float* heights, const Mark& mark,
                     const std::vector<char>& has_voids, const StopToken& stop, Use&& use) {
  constexpr int kSide = TileOfVoids::kSide;
  const auto down = static_cast<std::size_t>((window.rows + kSide - 1) / kSide);
  std::vector<std::vector<FilledPost>> filled(down);
  in_parallel(down, [&](std::size_t strip) {
    stop.check();
    const int first = static_cast<int>(strip) * kSide, past_last = std::min(first + kSide, window.rows);
    if (std::none_of(has_voids.begin() + first, has_voids.begin() + past_last, [](char has) { return has; })) return;
    for (int column = 0; column < window.cols; column += kSide) {
      const std::vector<FilledPost> tile = TileOfVoids(window, heights, first, column).filled(mark);
      filled[strip].insert(filled[strip].end(), tile.begin(), tile.end());
    }
    std::sort(filled[strip].begin(), filled[strip].end(),
              [](const FilledPost& a, const FilledPost& b) { return a.index < b.index; });
  });
  for (const std::vector<FilledPost>& strip : filled)
    for (const FilledPost& post : strip) use(post);
}

}  // namespace selenograph::dem
