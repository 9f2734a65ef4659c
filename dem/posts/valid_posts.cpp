#include "dem/posts/valid_posts.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "dem/gdal/remote_names.h"
#include "dem/support/error.h"

namespace selenograph::dem {

ValidPosts::ValidPosts(const Catalogue& catalogue, Read read, bool fall_through)
    : catalogue_(catalogue), read_(std::move(read)), fall_through_(fall_through) {}

void ValidPosts::read(int source, std::int64_t x0, std::int64_t y0, int w, int h, std::vector<char>& valid,
                      std::vector<SourceIndex>& unusable) const {
  std::vector<float> heights(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
  try {
    read_(source, static_cast<int>(x0), static_cast<int>(y0), w, h, heights.data());
  } catch (const DataError&) {
    if (!fall_through_) throw;
    unusable.push_back(static_cast<SourceIndex>(source));
    valid.assign(heights.size(), 0);
    return;
  }
  valid.resize(heights.size());
  // Comparisons with NaN are false.
  std::transform(heights.begin(), heights.end(), valid.begin(),
                 [](float m) { return m >= kLowestRelief_m && m <= kHighestRelief_m; });
}

// Those places that are not yet known to be covered, and less than a post away from the file.
std::vector<ValidPosts::Near> ValidPosts::near(const RasterInfo& info, const std::vector<Geographic>& places,
                                               Reach reach, const std::vector<char>& cover) {
  std::vector<Near> found;
  for (std::size_t i = 0; i < places.size(); ++i) {
    if (cover[i] >= kInside) continue;
    const PostXY p = locate(info, places[i].lat_deg, places[i].lon_deg);
    // How far outside, in posts.
    const auto outside = [](double v, int size) { return std::max({-v, v - (size - 1), 0.0}); };
    const double aside = info.wraps_longitude ? 0 : outside(p.x, info.width), above = outside(p.y, info.height);
    const double away = std::max(aside, above);
    // Between the outermost row of a file that holds the globe and a pole lies less than a post.
    const bool pole = info.wraps_longitude && above > 0;
    if (!(away < 1)) continue;
    constexpr double kRounding = 1e-6;
    const bool inside = pole || away <= (reach == Reach::half_a_post ? 0.5 : kRounding);
    int x = static_cast<int>(std::round(p.x));
    if (info.wraps_longitude && x >= info.width) x -= info.width;
    found.push_back({i, std::clamp(x, 0, info.width - 1),
                     std::clamp(static_cast<int>(std::round(p.y)), 0, info.height - 1), inside ? kInside : kBeside});
  }
  return found;
}

void ValidPosts::cover(int source, const std::vector<Geographic>& places, Reach reach, std::vector<char>& cover,
                       std::vector<SourceIndex>& unusable) const {
  const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
  const std::vector<Near> near = this->near(info, places, reach, cover);
  if (near.empty()) return;
  int x0 = info.width, y0 = info.height, x1 = 0, y1 = 0;
  for (const Near& at : near) {
    x0 = std::min(x0, at.x), x1 = std::max(x1, at.x);
    y0 = std::min(y0, at.y), y1 = std::max(y1, at.y);
  }
  const auto add = [&](const Near& at, bool valid) {
    if (valid) cover[at.place] = static_cast<char>(cover[at.place] + at.cover);
  };
  constexpr std::int64_t kMostAtOnce = 1 << 20;
  std::vector<char> valid;
  const int w = x1 - x0 + 1, h = y1 - y0 + 1;
  if (is_remote(info.path)) {
    for (const Near& at : near) add(at, true);
  } else if (std::int64_t{w} * h <= kMostAtOnce) {
    read(source, x0, y0, w, h, valid, unusable);
    for (const Near& at : near)
      add(at, valid[static_cast<std::size_t>(at.y - y0) * static_cast<std::size_t>(w) +
                    static_cast<std::size_t>(at.x - x0)]);
  } else {
    for (const Near& at : near) {
      read(source, at.x, at.y, 1, 1, valid, unusable);
      add(at, valid[0]);
    }
  }
}

}  // namespace selenograph::dem
