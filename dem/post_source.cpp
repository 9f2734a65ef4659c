#include "dem/post_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "dem/error.h"
#include "dem/gdal/raster.h"
#include "dem/parallel.h"
#include "dem/terrain.h"

namespace selenograph::dem {

// A rectangle of posts read from a file.
struct PostSource::Patch {
  int x0, y0, w, h;
  std::vector<float> posts;
  float at(int x, int y) const { return posts[index(x, y)]; }
  float& at(int x, int y) { return posts[index(x, y)]; }
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y - y0) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x - x0);
  }
};

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

// Catmull-Rom weights (Catmull & Rom 1974, tension 1/2) at fraction t between the middle two of four posts.
std::array<double, 4> cubic_weights(double t) {
  return {t * (-0.5 + t * (1.0 - 0.5 * t)), 1.0 + t * t * (-2.5 + 1.5 * t), t * (0.5 + t * (2.0 - 1.5 * t)),
          t * t * (-0.5 + 0.5 * t)};
}

template <typename Patch>
float bilinear(const Patch& patch, int x, int y, double fx, double fy) {
  double sum = 0;
  for (int j = 0; j < 2; ++j)
    for (int i = 0; i < 2; ++i) {
      const double weight = (i ? fx : 1 - fx) * (j ? fy : 1 - fy);
      if (weight == 0) continue;  // a place on a post needs no neighbour
      sum += weight * static_cast<double>(patch.at(x + i, y + j));
    }
  return static_cast<float>(sum);
}

// The patch must hold columns x-1 .. x+2 and rows y-1 .. y+2 around the place.
template <typename Patch>
float interpolate(const Patch& patch, double px, double py) {
  // Posts found a rounding error beside themselves are on themselves: neighbours that are void must not matter then.
  const double near_x = std::round(px), near_y = std::round(py);
  if (std::abs(px - near_x) < 1e-6) px = near_x;
  if (std::abs(py - near_y) < 1e-6) py = near_y;
  const int x = static_cast<int>(std::floor(px)), y = static_cast<int>(std::floor(py));
  const double fx = px - x, fy = py - y;
  if (fx == 0 && fy == 0) return patch.at(x, y);
  const auto wx = cubic_weights(fx), wy = cubic_weights(fy);
  double sum = 0;
  for (int j = 0; j < 4; ++j) {
    double row = 0;
    for (int i = 0; i < 4; ++i)
      row += wx[static_cast<std::size_t>(i)] * static_cast<double>(patch.at(x - 1 + i, y - 1 + j));
    sum += wy[static_cast<std::size_t>(j)] * row;
  }
  return std::isnan(sum) ? bilinear(patch, x, y, fx, fy) : static_cast<float>(sum);
}

// Beside a void or past the last row or column: less than a post from a valid one, along its slope. Without this a
// product whose posts are not vertices would lose its outermost posts with the quads around them.
template <typename Patch>
float extended(const Patch& patch, double px, double py) {
  const int x0 = static_cast<int>(std::floor(px)), y0 = static_cast<int>(std::floor(py));
  float best = kNaN;
  double nearest = std::numeric_limits<double>::infinity();
  for (int y = y0; y <= y0 + 1; ++y)
    for (int x = x0; x <= x0 + 1; ++x) {
      const float h = patch.at(x, y);
      const double dx = px - x, dy = py - y, distance = dx * dx + dy * dy;
      if (std::isnan(h) || distance >= nearest) continue;
      nearest = distance;
      const auto slope = [h](float before, float after) {
        return !std::isnan(before) ? h - before : !std::isnan(after) ? after - h : 0.F;
      };
      best = h + static_cast<float>(dx * static_cast<double>(slope(patch.at(x - 1, y), patch.at(x + 1, y))) +
                                    dy * static_cast<double>(slope(patch.at(x, y - 1), patch.at(x, y + 1))));
    }
  return best;
}

}  // namespace

// Enough for the tiles that one chunk and its neighbours touch (4 x 4 degrees of 1-degree tiles), few against the limit
// of 1024 descriptors.
constexpr std::size_t kIdleFiles = 32;

// Open files, lent to one thread at a time; the least recently returned are closed past kIdleFiles.
class PostSource::Pool {
 public:
  explicit Pool(const Catalogue& catalogue) : catalogue_(catalogue) {}

  template <typename Use>
  void with(int source, Use&& use) {
    std::unique_ptr<Raster> raster = take(source);
    if (!raster) raster = std::make_unique<Raster>(catalogue_.rasters()[static_cast<std::size_t>(source)]);
    use(*raster);  // a file that fails isn't kept
    std::lock_guard lock(mutex_);
    idle_.emplace_front(source, std::move(raster));
    if (idle_.size() > kIdleFiles) idle_.pop_back();
  }

 private:
  std::unique_ptr<Raster> take(int source) {
    std::lock_guard lock(mutex_);
    const auto found = std::find_if(idle_.begin(), idle_.end(), [&](const auto& e) { return e.first == source; });
    if (found == idle_.end()) return nullptr;
    std::unique_ptr<Raster> raster = std::move(found->second);
    idle_.erase(found);
    return raster;
  }

  const Catalogue& catalogue_;
  std::mutex mutex_;
  std::list<std::pair<int, std::unique_ptr<Raster>>> idle_;
};

PostSource::PostSource(const Catalogue& catalogue, bool fall_through, Warn warn)
    : catalogue_(catalogue),
      fall_through_(fall_through),
      warn_(std::move(warn)),
      pool_(std::make_unique<Pool>(catalogue)) {
  for (const RasterInfo& info : catalogue.rasters()) post_deg_ = std::max(post_deg_, 1 / info.posts_per_degree);
}

PostSource::~PostSource() = default;

int PostSource::level_needed(const RasterInfo& info) {
  if (info.lattice_level) return std::clamp(*info.lattice_level, 0, kMaxLevel);
  const double octaves = std::log2(info.posts_per_degree);
  // 2^n px/deg that are not vertices of level n lie half a pixel off (pixel is area): they are vertices of the next
  // level.
  const bool half_pixel = info.projection() == Projection::geographic && std::abs(octaves - std::round(octaves)) < 1e-9;
  return std::clamp(static_cast<int>(std::ceil(octaves - 1e-9)) + (half_pixel ? 1 : 0), 0, kMaxLevel);
}

Posts PostSource::compose(const PostWindow& window, const StopToken& stop) const {
  Posts posts{std::vector<float>(window.size(), kNaN), std::vector<SourceMark>(window.size(), kNoSource), {}};
  // Rows in strips: small reads, and a strip past a pole or on one is a window of its own.
  constexpr int kStrip = 256;
  const int strips = (window.rows + kStrip - 1) / kStrip;
  in_parallel(static_cast<std::size_t>(strips), [&](std::size_t strip) {
    const int first = static_cast<int>(strip) * kStrip;
    compose_rows(window, first, std::min(window.rows, first + kStrip), posts, stop);
  });
  std::sort(posts.replaced.begin(), posts.replaced.end());
  posts.replaced.erase(std::unique(posts.replaced.begin(), posts.replaced.end()), posts.replaced.end());
  return posts;
}

namespace {

// A pole that no file holds (tiles of one product end a post before the south pole) is one point all the same: the mean
// of 16 posts around it, the same whatever window asks. Returns what was replaced there.
std::vector<SourceIndex> fill_pole(const PostSource& source, const PostWindow& pole, std::size_t offset, Posts& posts) {
  PostWindow ring = pole;
  ring.lat0 = pole.lat0 == 0 ? pole.lat_step : pole.lat0 - pole.lat_step;
  ring.lon0 = 0, ring.cols = 16, ring.rows = 1, ring.lon_step = kLonTicks / ring.cols;
  const Posts around = source.compose(ring);
  double sum = 0;
  for (const float h : around.heights) sum += static_cast<double>(h);
  if (std::isnan(sum)) return around.replaced;
  std::fill_n(posts.heights.begin() + static_cast<std::ptrdiff_t>(offset), pole.cols,
              static_cast<float>(sum / ring.cols));
  std::fill_n(posts.sources.begin() + static_cast<std::ptrdiff_t>(offset), pole.cols, around.sources[0] | kFilledBit);
  return around.replaced;
}

}  // namespace

// Splits rows at the poles. At a pole a row is one point: it takes the value at longitude -180 of the finest layer
// there.
void PostSource::compose_rows(const PostWindow& window, int r0, int r1, Posts& posts, const StopToken& stop) const {
  const auto lat_of = [&](int r) { return window.lat0 + static_cast<std::int64_t>(r) * window.lat_step; };
  const auto zone = [&](int r) {
    return lat_of(r) <= 0 ? (lat_of(r) == 0 ? 1 : 0) : lat_of(r) < kLatTicks ? 2 : lat_of(r) == kLatTicks ? 3 : 4;
  };
  while (r0 < r1) {
    int end = r0 + 1;
    while (end < r1 && zone(end) == zone(r0)) ++end;
    PostWindow part = window;
    part.rows = end - r0;
    part.lat0 = lat_of(r0);
    const int z = zone(r0);
    if (z == 0 || z == 4) {  // beyond a pole: the opposite meridian, rows running back
      part.lat0 = z == 0 ? -part.lat0 : 2 * static_cast<std::int64_t>(kLatTicks) - part.lat0;
      part.lat_step = -part.lat_step;
      part.lon0 += kLonTicks / 2;
    }
    const std::size_t offset = static_cast<std::size_t>(r0) * static_cast<std::size_t>(window.cols);
    const double south = lat_deg_of(static_cast<std::int32_t>(
        std::min(part.lat0, part.lat0 + static_cast<std::int64_t>(part.rows - 1) * part.lat_step)));
    const double north = lat_deg_of(static_cast<std::int32_t>(
        std::max(part.lat0, part.lat0 + static_cast<std::int64_t>(part.rows - 1) * part.lat_step)));
    const double west = static_cast<double>(part.lon0) / kTicksPerDegree - 180;
    const double east = west + static_cast<double>(part.cols - 1) * part.lon_step / kTicksPerDegree;
    const bool pole = z == 1 || z == 3;
    // A file's kernel reaches a post beyond its outermost posts: to a pole that lies between posts, for one.
    const std::vector<int> layers = pole ? catalogue_.touching(south, north, -180, 180, post_deg_)
                                         : catalogue_.touching(south, north, west, east, post_deg_);
    bool complete = false;
    for (auto layer = layers.rbegin(); layer != layers.rend() && !complete; ++layer) {
      stop.check();
      complete = add_layer(*layer, part, offset, Reach::between_posts, posts);
    }
    for (auto layer = layers.rbegin(); layer != layers.rend() && !complete; ++layer)
      if (!catalogue_.rasters()[static_cast<std::size_t>(*layer)].lattice_level)
        complete = add_layer(*layer, part, offset, Reach::beside_posts, posts);
    if (pole && posts.sources[offset] == kNoSource) {
      const std::vector<SourceIndex> around = fill_pole(*this, part, offset, posts);
      const std::lock_guard lock(replaced_mutex_);
      posts.replaced.insert(posts.replaced.end(), around.begin(), around.end());
    }
    r0 = end;
  }
}

// Where a window's posts lie in a file. In a geographic file columns and rows are separable.
class PostSource::Mapping {
 public:
  Mapping(const RasterInfo& info, const PostWindow& window)
      : info_(info), window_(window), pole_(window.lat0 == 0 || window.lat0 == kLatTicks) {
    if (info.projection() != Projection::geographic) return;
    for (int c = 0; c < cols(); ++c) xs_.push_back(located(0, c).x);
    for (int r = 0; r < window.rows; ++r) ys_.push_back(located(r, 0).y);
    if (info.wraps_longitude)
      for (std::size_t c = 1; c < xs_.size(); ++c)
        while (xs_[c] < xs_[c - 1] - 0.5) xs_[c] += info.width;
  }

  int cols() const { return pole_ ? 1 : window_.cols; }
  bool pole() const { return pole_; }
  PostXY at(int r, int c) const {
    if (!xs_.empty()) return {xs_[static_cast<std::size_t>(c)], ys_[static_cast<std::size_t>(r)]};
    return located(r, c);
  }

  // The part of the file that the window needs, with the kernel's margin; empty (w = 0) when they don't meet.
  Patch patch() const {
    Range x, y;
    if (!xs_.empty()) {
      for (const double v : xs_) x.add(v, info_.wraps_longitude ? 1e300 : info_.width);
      for (const double v : ys_) y.add(v, info_.height);
    } else {
      for (int r = 0; r < window_.rows; ++r)
        for (int c = 0; c < cols(); ++c) {
          const PostXY q = located(r, c);
          if (q.x > -2 && q.y > -2 && q.x < info_.width + 1 && q.y < info_.height + 1)
            x.add(q.x, info_.width), y.add(q.y, info_.height);
        }
    }
    if (x.low > x.high || y.low > y.high) return {0, 0, 0, 0, {}};
    Patch patch{static_cast<int>(std::floor(x.low)) - 2, static_cast<int>(std::floor(y.low)) - 2, 0, 0, {}};
    patch.w = static_cast<int>(std::ceil(x.high)) + 4 - patch.x0;
    patch.h = static_cast<int>(std::ceil(y.high)) + 4 - patch.y0;
    patch.posts.resize(static_cast<std::size_t>(patch.w) * static_cast<std::size_t>(patch.h));
    return patch;
  }

 private:
  struct Range {
    double low = 1e300, high = -1e300;
    void add(double v, double size) {
      if (v > -2 && v < size + 1) low = std::min(low, v), high = std::max(high, v);
    }
  };

  PostXY located(int r, int c) const {
    // A tile that touches a pole holds the pole in each of its columns: any longitude it covers will do.
    const double lon = pole_ ? info_.footprint.west_deg
                             : lon_deg_of(wrap_lon(window_.lon0 + static_cast<std::int64_t>(c) * window_.lon_step));
    return locate(info_,
                  lat_deg_of(static_cast<std::int32_t>(window_.lat0 + static_cast<std::int64_t>(r) * window_.lat_step)),
                  lon);
  }

  const RasterInfo& info_;
  const PostWindow& window_;
  bool pole_;
  std::vector<double> xs_, ys_;
};

// Tiles of one product leave a gap of a post between them. Where posts are not on the lattice, the kernel would find no
// neighbours there, so posts that the patch lacks are taken from the tiles beside it that continue its grid.
void PostSource::close_gaps(int source, Patch& patch) const {
  const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
  if (info.projection() != Projection::geographic || info.lattice_level || info.wraps_longitude) return;
  if (std::none_of(patch.posts.begin(), patch.posts.end(), [](float h) { return std::isnan(h); })) return;
  const Footprint& f = info.footprint;
  const double post_deg = 1 / info.posts_per_degree, globe = 360 * info.posts_per_degree;
  for (const int other : catalogue_.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, 4 * post_deg)) {
    const RasterInfo& tile = catalogue_.rasters()[static_cast<std::size_t>(other)];
    if (other == source || tile.projection() != Projection::geographic ||
        std::abs(tile.posts_per_degree / info.posts_per_degree - 1) > 1e-9)
      continue;
    const double dx = std::remainder((tile.footprint.west_deg - f.west_deg) * info.posts_per_degree, globe);
    const double dy = (f.north_deg - tile.footprint.north_deg) * info.posts_per_degree;
    if (std::abs(dx - std::round(dx)) > 1e-3 || std::abs(dy - std::round(dy)) > 1e-3) continue;
    const int ix = static_cast<int>(std::lround(dx)), iy = static_cast<int>(std::lround(dy));
    const int x0 = std::max(patch.x0, ix), x1 = std::min(patch.x0 + patch.w, ix + tile.width);
    const int y0 = std::max(patch.y0, iy), y1 = std::min(patch.y0 + patch.h, iy + tile.height);
    if (x0 >= x1 || y0 >= y1) continue;
    Patch piece{x0, y0, x1 - x0, y1 - y0,
                std::vector<float>(static_cast<std::size_t>(x1 - x0) * static_cast<std::size_t>(y1 - y0))};
    pool_->with(other, [&](Raster& raster) { raster.read(x0 - ix, y0 - iy, piece.w, piece.h, piece.posts.data()); });
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x)
        if (std::isnan(patch.at(x, y))) patch.at(x, y) = piece.at(x, y);
  }
}

// Writes the layer's valid posts where there is none yet. True when nothing is left to fill.
bool PostSource::add_layer(int source, const PostWindow& window, std::size_t offset, Reach reach, Posts& posts) const {
  const Mapping mapping(catalogue_.rasters()[static_cast<std::size_t>(source)], window);
  Patch patch = mapping.patch();
  if (patch.w == 0) return false;
  try {
    pool_->with(source, [&](Raster& raster) { raster.read(patch.x0, patch.y0, patch.w, patch.h, patch.posts.data()); });
    close_gaps(source, patch);
  } catch (const DataError& error) {
    if (!fall_through_) throw;
    {
      const std::lock_guard lock(replaced_mutex_);
      posts.replaced.push_back(static_cast<SourceIndex>(source));
    }
    warn_(error.file(), error.what());
    return false;
  }
  bool complete = true;
  std::size_t impossible = 0;
  for (int r = 0; r < window.rows; ++r)
    for (int c = 0; c < mapping.cols(); ++c) {
      const std::size_t at =
          offset + static_cast<std::size_t>(r) * static_cast<std::size_t>(window.cols) + static_cast<std::size_t>(c);
      if (posts.sources[at] != kNoSource) continue;
      const PostXY q = mapping.at(r, c);
      const bool inside =
          q.x >= patch.x0 + 1 && q.y >= patch.y0 + 1 && q.x <= patch.x0 + patch.w - 3 && q.y <= patch.y0 + patch.h - 3;
      float h = !inside                         ? kNaN
                : reach == Reach::between_posts ? interpolate(patch, q.x, q.y)
                                                : extended(patch, q.x, q.y);
      if (h < kLowestRelief_m || h > kHighestRelief_m) h = kNaN, ++impossible;
      complete &= !std::isnan(h);
      if (std::isnan(h)) continue;
      posts.heights[at] = h;
      posts.sources[at] = static_cast<SourceMark>(source) | (reach == Reach::beside_posts ? kFilledBit : 0);
    }
  if (impossible > 0) {
    const std::string& path = catalogue_.rasters()[static_cast<std::size_t>(source)].path;
    warn_(path, fmt::format("{}: posts outside of {} .. {} m taken as voids", path, kLowestRelief_m, kHighestRelief_m));
  }
  if (mapping.pole() && posts.sources[offset] != kNoSource) {
    std::fill_n(posts.heights.begin() + static_cast<std::ptrdiff_t>(offset), window.cols, posts.heights[offset]);
    std::fill_n(posts.sources.begin() + static_cast<std::ptrdiff_t>(offset), window.cols, posts.sources[offset]);
  }
  return complete;
}

namespace {

// Distance in posts to the nearest valid post in one direction along a row or column; 0: none within kFillReach.
using Distances = std::vector<std::uint8_t>;
static_assert(kFillReach < 256);

// Follows `steps` lines at once, each moving by `advance` elements a step, neighbouring lines lying `apart` elements
// apart.
Distances distances(const std::vector<float>& h, std::ptrdiff_t start, std::ptrdiff_t advance, int length,
                    std::ptrdiff_t apart, int lines) {
  Distances out(h.size(), 0);
  in_parallel_pieces(static_cast<std::size_t>(lines), 256, [&](std::size_t first, std::size_t past_last) {
    std::vector<std::uint8_t> since(past_last - first, 0);  // posts since the last valid one, 0: too long ago
    for (int step = 0; step < length; ++step)
      for (std::size_t line = first; line < past_last; ++line) {
        const auto at = static_cast<std::size_t>(start + step * advance + static_cast<std::ptrdiff_t>(line) * apart);
        std::uint8_t& s = since[line - first];
        if (!std::isnan(h[at])) {
          s = 1;
        } else {
          out[at] = s;
          s = s == 0 || s == kFillReach ? 0 : static_cast<std::uint8_t>(s + 1);
        }
      }
  });
  return out;
}

}  // namespace

void PostSource::fill_voids(const PostWindow& window, Posts& posts, const StopToken& stop) {
  const std::vector<float>& h = posts.heights;
  if (std::none_of(h.begin(), h.end(), [](float v) { return std::isnan(v); })) return;
  const int rows = window.rows, cols = window.cols;
  const std::ptrdiff_t row = cols, last = static_cast<std::ptrdiff_t>(h.size()) - 1;
  const Distances west = distances(h, 0, 1, cols, row, rows), east = distances(h, last, -1, cols, -row, rows);
  const Distances south = distances(h, 0, row, rows, 1, cols), north = distances(h, last, -row, rows, -1, cols);
  // Values and sources of valid posts are only read, those of voids only written: one pass in place.
  in_parallel(static_cast<std::size_t>(rows), [&](std::size_t r) {
    stop.check();
    for (std::size_t at = r * static_cast<std::size_t>(cols); at < (r + 1) * static_cast<std::size_t>(cols); ++at) {
      double sum = 0, weight = 0;
      int nearest = kFillReach + 1;
      SourceMark source = kNoSource;
      const auto between = [&](int before, int after, std::ptrdiff_t step) {
        if (before == 0 || after == 0) return;
        for (const auto& [distance, from] : {std::pair{before, static_cast<std::ptrdiff_t>(at) - before * step},
                                             {after, static_cast<std::ptrdiff_t>(at) + after * step}}) {
          sum += static_cast<double>(h[static_cast<std::size_t>(from)]) / distance, weight += 1.0 / distance;
          if (distance < nearest) nearest = distance, source = posts.sources[static_cast<std::size_t>(from)];
        }
      };
      between(west[at], east[at], 1);
      between(south[at], north[at], row);
      if (weight == 0) continue;
      posts.heights[at] = static_cast<float>(sum / weight);
      posts.sources[at] = source | kFilledBit;
    }
  });
}

}  // namespace selenograph::dem
