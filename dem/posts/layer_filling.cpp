#include "dem/posts/layer_filling.h"

#include <algorithm>
#include <array>
#include <limits>
#include <vector>

#include "dem/posts/tile_of_voids.h"

namespace selenograph::dem {

namespace {

double lat_deg_at(const PostWindow& window, int r) { return lat_deg_of(window.lat0 + r * window.lat_step); }

// Returns the longitude of a window's column. A pole is one point, which a tile that touches it holds in each column:
// use any longitude that the tile covers.
double lon_deg_at(const RasterInfo& info, const PostWindow& window, int c, bool pole) {
  return pole ? info.footprint.west_deg : lon_deg_of(wrap_lon(window.lon0 + c * window.lon_step));
}

// Returns the position in a file of the post in row `r` and column `c` of a window.
PostXY located(const RasterInfo& info, const PostWindow& window, int r, int c, bool pole) {
  return locate(info, lat_deg_at(window, r), lon_deg_at(info, window, c, pole));
}

// Caches a patch's rows, interpolated along the row at the window's columns. Consecutive rows of the window use the
// same four rows of the file.
class InterpolatedRows {
 public:
  InterpolatedRows(const PostPatch& patch, const FileColumns& columns) : patch_(patch), columns_(columns) {
    rows_.fill(std::numeric_limits<int>::min());
  }

  // Returns the interpolated heights of row `y` of the file, one per column of the window.
  const double* row_heights(int y) {
    const auto slot = static_cast<std::size_t>(y & 3);
    if (rows_[slot] != y) {
      rows_[slot] = y;
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

std::optional<AxisSpan> PostRange::well_inside(const std::vector<double>& window_positions) const {
  if (empty()) return std::nullopt;
  // The kernel at v reads posts v - 1 to v + 2.
  const auto inside = [&](double v) { return v >= first() + 1 && v <= past_last() - 3; };
  const auto from = std::find_if(window_positions.begin(), window_positions.end(), inside),
             to = std::find_if_not(from, window_positions.end(), inside);
  if (std::any_of(to, window_positions.end(), inside)) return std::nullopt;
  AxisSpan span{
      static_cast<int>(from - window_positions.begin()), static_cast<int>(to - window_positions.begin()), {}, true};
  span.positions.reserve(static_cast<std::size_t>(to - from));
  for (auto v = from; v != to; ++v) {
    span.positions.emplace_back(*v);
    span.on_posts &= span.positions.back().fraction == 0;
  }
  return span;
}

FileColumns::FileColumns(const RasterInfo& info, const PostWindow& window, bool pole) {
  xs.reserve(static_cast<std::size_t>(window.cols));
  for (int c = 0; c < (pole ? 1 : window.cols); ++c) xs.push_back(located(info, window, 0, c, pole).x);
  // Make the columns of a global file ascend where the window crosses its last column.
  if (info.wraps_longitude)
    for (std::size_t c = 1; c < xs.size(); ++c)
      while (xs[c] < xs[c - 1] - 0.5) xs[c] += info.width;
  for (const double v : xs) range.add(v, info.wraps_longitude ? 1e300 : info.width);
  span = range.well_inside(xs);
  if (!span) return;
  for (const PostPosition& position : span->positions) {
    first_.push_back(position.post - 1 - range.first());
    const std::array<double, 4> four = cubic_weights(position.fraction);
    for (std::size_t k = 0; k < 4; ++k) weights_[k].push_back(four[k]);
  }
}

// Locates columns and rows separately in a geographic file, every post in a file on a plane.
WindowMapping::WindowMapping(const RasterInfo& info, int source, const PostWindow& window, ColumnsOfFiles& files)
    : info_(info), window_(window), pole_(window.lat0 == 0 || window.lat0 == kLatTicks) {
  if (info.projection() == Projection::geographic) {
    columns_ = files.find_or_create(info, source, window, pole_);
    x_ = columns_->range;
    for (int r = 0; r < window.rows; ++r) ys_.push_back(located(info, window, r, 0, pole_).y);
    for (const double v : ys_) y_.add(v, info.height);
    return;
  }
  // Compute sines and cosines once per row and column: a direction is the product of its meridian's and its parallel's.
  const auto unit = [](double lat_deg, double lon_deg) {
    return Vec3(to_cartesian({lat_deg, lon_deg, 0}) / kMoonRadius_m);
  };
  std::vector<Vec3> meridians;
  meridians.reserve(static_cast<std::size_t>(cols()));
  for (int c = 0; c < cols(); ++c) meridians.push_back(unit(0, lon_deg_at(info, window, c, pole_)));
  const PlanePosts posts(std::get<PlaneGrid>(info.grid), info.width, info.height);
  positions_.reserve(static_cast<std::size_t>(window_.rows) * static_cast<std::size_t>(cols()));
  for (int r = 0; r < window_.rows; ++r) {
    const Vec3 parallel = unit(lat_deg_at(window, r), 0);
    for (const Vec3& meridian : meridians) {
      const PostXY q = positions_.emplace_back(
          posts.locate(Vec3(parallel.x() * meridian.x(), parallel.x() * meridian.y(), parallel.z())));
      if (q.x > -2 && q.y > -2 && q.x < info_.width + 1 && q.y < info_.height + 1) {
        x_.add(q.x, info_.width);
        y_.add(q.y, info_.height);
      }
    }
  }
}

// Copies rows where the window's posts are posts of the file, interpolates them elsewhere.
void fill_rows(const PostPatch& patch, const FileColumns& all_columns, const AxisSpan& rows, LayerFilling& filling) {
  const AxisSpan& columns = *all_columns.span;
  const int n = columns.past_last - columns.first;
  const auto count = static_cast<std::size_t>(n);
  const bool copied = columns.on_posts && rows.on_posts;
  const bool is_contiguous = columns.is_contiguous();
  std::vector<float> heights(count);
  InterpolatedRows interpolated(patch, all_columns);
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
      add_four_rows({interpolated.row_heights(first), interpolated.row_heights(first + 1),
                     interpolated.row_heights(first + 2), interpolated.row_heights(first + 3)},
                    cubic_weights(y.fraction), n, heights.data());
      // Repeat posts next to a void one by one: they are interpolated bilinearly where that has no void.
      if (any_void(heights.data(), n))
        for (std::size_t i = 0; i < count; ++i)
          if (std::isnan(heights[i])) heights[i] = interpolate(patch, columns.positions[i], y);
    }
    filling.add_row(r, columns.first, heights.data(), n);
  }
}

}  // namespace selenograph::dem
