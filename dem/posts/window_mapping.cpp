#include "dem/posts/window_mapping.h"

#include <algorithm>

#include "dem/posts/cubic.h"

namespace selenograph::dem {

namespace {

double lat_deg_at(const PostWindow& window, int r) {
  return lat_deg_of(static_cast<std::int32_t>(window.lat0 + static_cast<std::int64_t>(r) * window.lat_step));
}

// Returns the longitude of a window's column. A pole is one point, which a tile that touches it holds in each column:
// use any longitude that the tile covers.
double lon_deg_at(const RasterInfo& info, const PostWindow& window, int c, bool pole) {
  return pole ? info.footprint.west_deg
              : lon_deg_of(wrap_lon(window.lon0 + static_cast<std::int64_t>(c) * window.lon_step));
}

PostXY located(const RasterInfo& info, const PostWindow& window, int r, int c, bool pole) {
  return locate(info, lat_deg_at(window, r), lon_deg_at(info, window, c, pole));
}

}  // namespace

std::optional<AxisSpan> PostRange::well_inside(const std::vector<double>& window_positions) const {
  if (empty()) return std::nullopt;
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

}  // namespace selenograph::dem
