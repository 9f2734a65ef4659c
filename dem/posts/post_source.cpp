#include "dem/posts/post_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <tuple>
#include <utility>

#include "dem/gdal/raster.h"
#include "dem/posts/cubic.h"
#include "dem/posts/post_kernels.h"
#include "dem/posts/tile_of_voids.h"
#include "dem/support/error.h"
#include "dem/support/parallel.h"

namespace selenograph::dem {

// A rectangle of posts read from a file.
struct PostSource::Patch {
  int x0, y0, w, h;
  UninitialisedVector<float> posts;
  float at(int x, int y) const { return posts[index(x, y)]; }
  float& at(int x, int y) { return posts[index(x, y)]; }
  std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y - y0) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x - x0);
  }
};

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

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

// Along a row or column: at or after a post. Places a rounding error beside a post are on it: neighbours that are void
// must not matter then.
struct Place {
  int post;
  double fraction;
  explicit Place(double v) {
    if (const double near = std::round(v); std::abs(v - near) < 1e-6) v = near;
    post = static_cast<int>(std::floor(v)), fraction = v - post;
  }
};

// The patch must hold columns x-1 .. x+2 and rows y-1 .. y+2 around the place.
template <typename Patch>
float interpolate(const Patch& patch, const Place& px, const Place& py) {
  const int x = px.post, y = py.post;
  const double fx = px.fraction, fy = py.fraction;
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

  // use(raster) fails when the file changed under it. A file that was only touched, or is what it was again, is opened
  // anew; opening fails where it is another than was catalogued.
  template <typename Use>
  void with(int source, Use&& use) {
    constexpr int kAttempts = 3;
    std::unique_ptr<Raster> raster = take(source);
    for (int attempt = 1;; ++attempt) {
      if (!raster) raster = std::make_unique<Raster>(catalogue_.rasters()[static_cast<std::size_t>(source)]);
      try {
        use(*raster);
        break;
      } catch (const DataError&) {  // a file that fails isn't kept
        if (attempt == kAttempts || raster->current()) throw;
        raster.reset();
      }
    }
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
      pool_(std::make_unique<Pool>(catalogue)),
      edges_(
          catalogue, [this](int source, int x0, int y0, int w, int h, float* m) { read(source, x0, y0, w, h, m); },
          fall_through),
      borders_(catalogue) {
  for (const RasterInfo& info : catalogue.rasters()) post_deg_ = std::max(post_deg_, widest_post_deg(info));
}

PostSource::~PostSource() = default;

void PostSource::read(int source, int x0, int y0, int w, int h, float* heights_m) const {
  pool_->with(source, [&](Raster& raster) { raster.read(x0, y0, w, h, heights_m); });
  if (const double offset_m = catalogue_.offset_m(source); offset_m != 0) {
    const std::size_t count = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
    for (std::size_t i = 0; i < count; ++i)
      heights_m[i] = static_cast<float>(static_cast<double>(heights_m[i]) + offset_m);
  }
}

// Some rows of a window that are composed together, and where their posts go.
struct PostSource::Strip {
  int first, past_last;
  float* heights;
  SourceMark* sources;
  // Of the whole window.
  std::vector<SourceIndex>* replaced;
  ColumnsOfFiles* columns;
  int files;           // of the catalogue: the first so many
  bool joined = true;  // with the triangles of coarser posts
};

// Rows in strips: small reads, and a strip past a pole or on one is a window of its own.
template <typename Use>
void PostSource::for_strips(const PostWindow& window, const StopToken& stop, Use&& use) const {
  constexpr int kStripRows = TileOfVoids::kSide, kFewRows = 256;
  const int strip_rows = window.rows <= kFewRows ? window.rows : kStripRows;
  in_parallel(static_cast<std::size_t>((window.rows + strip_rows - 1) / strip_rows), [&](std::size_t strip) {
    stop.check();
    const int first = static_cast<int>(strip) * strip_rows;
    use(first, std::min(strip_rows, window.rows - first));
  });
}

namespace {

// A pole that no file holds (tiles of one product end a post before the south pole) is one point all the same: the mean
// of 16 posts around it, the same whatever window asks. Returns what was replaced there.
std::vector<SourceIndex> fill_pole(const PostSource& source, const PostWindow& pole, float* heights,
                                   SourceMark* sources) {
  PostWindow ring = pole;
  ring.lat0 = pole.lat0 == 0 ? pole.lat_step : pole.lat0 - pole.lat_step;
  ring.lon0 = 0, ring.cols = 16, ring.rows = 1, ring.lon_step = kLonTicks / ring.cols;
  const Posts around = source.compose(ring);
  double sum = 0;
  for (const float h : around.heights) sum += static_cast<double>(h);
  if (std::isnan(sum)) return around.replaced;
  std::fill_n(heights, pole.cols, static_cast<float>(sum / ring.cols));
  std::fill_n(sources, pole.cols, around.sources[0] | kFilledBit);
  return around.replaced;
}

}  // namespace

// Splits rows at the poles. At a pole a row is one point: it takes the value at longitude -180 of the finest layer
// there.
void PostSource::compose_strip(const PostWindow& window, const Strip& strip, const StopToken& stop) const {
  const auto count = static_cast<std::size_t>(strip.past_last - strip.first) * static_cast<std::size_t>(window.cols);
  std::fill_n(strip.heights, count, kNaN);
  std::fill_n(strip.sources, count, kNoSource);
  const auto lat_of = [&](int r) { return window.lat0 + static_cast<std::int64_t>(r) * window.lat_step; };
  const auto zone = [&](int r) {
    return lat_of(r) <= 0 ? (lat_of(r) == 0 ? 1 : 0) : lat_of(r) < kLatTicks ? 2 : lat_of(r) == kLatTicks ? 3 : 4;
  };
  for (int r0 = strip.first; r0 < strip.past_last;) {
    int end = r0 + 1;
    while (end < strip.past_last && zone(end) == zone(r0)) ++end;
    PostWindow part = window;
    part.rows = end - r0;
    part.lat0 = lat_of(r0);
    const int z = zone(r0);
    if (z == 0 || z == 4) {  // beyond a pole: the opposite meridian, rows running back
      part.lat0 = z == 0 ? -part.lat0 : 2 * static_cast<std::int64_t>(kLatTicks) - part.lat0;
      part.lat_step = -part.lat_step;
      part.lon0 += kLonTicks / 2;
    }
    const std::size_t offset = static_cast<std::size_t>(r0 - strip.first) * static_cast<std::size_t>(window.cols);
    compose_part(part, offset, strip, stop);
    r0 = end;
  }
}

// Rows between the poles, or one that is a pole.
void PostSource::compose_part(const PostWindow& part, std::size_t offset, const Strip& strip,
                              const StopToken& stop) const {
  const bool pole = part.lat0 == 0 || part.lat0 == kLatTicks;
  const double south = lat_deg_of(static_cast<std::int32_t>(
      std::min(part.lat0, part.lat0 + static_cast<std::int64_t>(part.rows - 1) * part.lat_step)));
  const double north = lat_deg_of(static_cast<std::int32_t>(
      std::max(part.lat0, part.lat0 + static_cast<std::int64_t>(part.rows - 1) * part.lat_step)));
  const double west = static_cast<double>(part.lon0) / kTicksPerDegree - 180;
  const double east = west + static_cast<double>(part.cols - 1) * part.lon_step / kTicksPerDegree;
  // A file's kernel reaches a post beyond its outermost posts: to a pole that lies between posts, for one.
  std::vector<int> layers = pole ? catalogue_.touching(south, north, -180, 180, post_deg_)
                                 : catalogue_.touching(south, north, west, east, post_deg_);
  layers.erase(std::lower_bound(layers.begin(), layers.end(), strip.files), layers.end());
  std::size_t missing = pole ? 1 : part.size();
  for (auto layer = layers.rbegin(); layer != layers.rend() && missing > 0; ++layer) {
    stop.check();
    missing -= add_layer(*layer, part, offset, Reach::between_posts, strip);
  }
  for (auto layer = layers.rbegin(); layer != layers.rend() && missing > 0; ++layer)
    if (!catalogue_.rasters()[static_cast<std::size_t>(*layer)].lattice_level)
      missing -= add_layer(*layer, part, offset, Reach::beside_posts, strip);
  if (strip.joined && !pole) join(part, offset, strip, stop);
  if (!catalogue_.one_layer() && catalogue_.joins().blend_posts > 0) blend(part, offset, strip, stop);
  const bool all = strip.files == static_cast<int>(catalogue_.rasters().size());
  if (pole && all && strip.sources[offset] == kNoSource) {
    const std::vector<SourceIndex> around = fill_pole(*this, part, strip.heights + offset, strip.sources + offset);
    const std::lock_guard lock(replaced_mutex_);
    strip.replaced->insert(strip.replaced->end(), around.begin(), around.end());
  }
}

// Some columns or rows of a window, and where they lie in a file.
struct PostSource::Part {
  int first = 0, past_last = 0;
  std::vector<Place> places;
  bool on_posts = true;  // all of them
  bool in_one_piece() const {
    for (std::size_t i = 1; i < places.size(); ++i)
      if (places[i].post != places[i - 1].post + 1) return false;
    return !places.empty();
  }
};

// Of places along columns or rows those in a file or just beside it, and the posts that they need with the kernel's
// margin.
struct PostSource::Range {
  double low = 1e300, high = -1e300;
  void add(double v, double size) {
    if (v > -2 && v < size + 1) low = std::min(low, v), high = std::max(high, v);
  }
  bool empty() const { return low > high; }
  int first() const { return static_cast<int>(std::floor(low)) - 2; }
  int past_last() const { return static_cast<int>(std::ceil(high)) + 4; }

  // In a geographic file: the window's columns or rows that lie well inside of what is read, if they follow each other.
  // Nothing otherwise: then each post is to be looked at.
  std::optional<Part> well_inside(const std::vector<double>& all) const {
    if (empty()) return std::nullopt;
    const auto inside = [&](double v) { return v >= first() + 1 && v <= past_last() - 3; };
    const auto from = std::find_if(all.begin(), all.end(), inside), to = std::find_if_not(from, all.end(), inside);
    if (std::any_of(to, all.end(), inside)) return std::nullopt;
    Part part{static_cast<int>(from - all.begin()), static_cast<int>(to - all.begin()), {}, true};
    part.places.reserve(static_cast<std::size_t>(to - from));
    for (auto v = from; v != to; ++v) {
      part.places.emplace_back(*v);
      part.on_posts &= part.places.back().fraction == 0;
    }
    return part;
  }
};

namespace {

PostXY located(const RasterInfo& info, const PostWindow& window, int r, int c, bool pole) {
  // A tile that touches a pole holds the pole in each of its columns: any longitude it covers will do.
  const double lon = pole ? info.footprint.west_deg
                          : lon_deg_of(wrap_lon(window.lon0 + static_cast<std::int64_t>(c) * window.lon_step));
  return locate(
      info, lat_deg_of(static_cast<std::int32_t>(window.lat0 + static_cast<std::int64_t>(r) * window.lat_step)), lon);
}

}  // namespace

// A window's columns in a geographic file: the same for all of its strips.
class PostSource::Columns {
 public:
  Columns(const RasterInfo& info, const PostWindow& window, bool pole) {
    xs.reserve(static_cast<std::size_t>(window.cols));
    for (int c = 0; c < (pole ? 1 : window.cols); ++c) xs.push_back(located(info, window, 0, c, pole).x);
    if (info.wraps_longitude)
      for (std::size_t c = 1; c < xs.size(); ++c)
        while (xs[c] < xs[c - 1] - 0.5) xs[c] += info.width;
    for (const double v : xs) range.add(v, info.wraps_longitude ? 1e300 : info.width);
    part = range.well_inside(xs);
    if (!part) return;
    for (const Place& place : part->places) {
      first_.push_back(place.post - 1 - range.first());
      const std::array<double, 4> four = cubic_weights(place.fraction);
      for (std::size_t k = 0; k < 4; ++k) weights_[k].push_back(four[k]);
    }
  }

  // For interpolate_row(), of the part's columns in a row of the range.
  RowPlaces row_places() const {
    return {first_.data(), {weights_[0].data(), weights_[1].data(), weights_[2].data(), weights_[3].data()}};
  }

  std::vector<double> xs;
  Range range;
  std::optional<Part> part;  // well inside

 private:
  std::vector<std::int32_t> first_;
  std::array<std::vector<double>, 4> weights_;
};

// Of the files that a window's strips are composed of.
class PostSource::ColumnsOfFiles {
 public:
  std::shared_ptr<const Columns> of(const RasterInfo& info, int source, const PostWindow& window, bool pole) {
    const std::lock_guard lock(mutex_);
    std::shared_ptr<const Columns>& columns = known_[{source, window.lon0, pole}];
    if (!columns) columns = std::make_shared<const Columns>(info, window, pole);
    return columns;
  }

 private:
  std::mutex mutex_;
  std::map<std::tuple<int, std::int64_t, bool>, std::shared_ptr<const Columns>> known_;
};

// Where a window's posts lie in a file. In a geographic file columns and rows are separable.
class PostSource::Mapping {
 public:
  Mapping(const RasterInfo& info, int source, const PostWindow& window, ColumnsOfFiles& files)
      : info_(info), window_(window), pole_(window.lat0 == 0 || window.lat0 == kLatTicks) {
    if (info.projection() == Projection::geographic) {
      columns_ = files.of(info, source, window, pole_);
      x_ = columns_->range;
      for (int r = 0; r < window.rows; ++r) ys_.push_back(located(info, window, r, 0, pole_).y);
      for (const double v : ys_) y_.add(v, info.height);
      return;
    }
    places_.reserve(static_cast<std::size_t>(window_.rows) * static_cast<std::size_t>(cols()));
    for (int r = 0; r < window_.rows; ++r)
      for (int c = 0; c < cols(); ++c) {
        const PostXY q = places_.emplace_back(located(info_, window_, r, c, pole_));
        if (q.x > -2 && q.y > -2 && q.x < info_.width + 1 && q.y < info_.height + 1)
          x_.add(q.x, info_.width), y_.add(q.y, info_.height);
      }
  }

  int cols() const { return pole_ ? 1 : window_.cols; }
  bool pole() const { return pole_; }

  // Null and nothing where each post is to be looked at.
  const Columns* columns() const { return columns_ && columns_->part ? columns_.get() : nullptr; }
  std::optional<Part> rows() const { return y_.well_inside(ys_); }

  PostXY at(int r, int c) const {
    if (columns_) return {columns_->xs[static_cast<std::size_t>(c)], ys_[static_cast<std::size_t>(r)]};
    return places_[static_cast<std::size_t>(r) * static_cast<std::size_t>(cols()) + static_cast<std::size_t>(c)];
  }

  // The part of the file that the window needs, with the kernel's margin; empty (w = 0) when they don't meet.
  struct Box {
    int x0, y0, w, h;
  };
  Box box() const {
    if (x_.empty() || y_.empty()) return {0, 0, 0, 0};
    return {x_.first(), y_.first(), x_.past_last() - x_.first(), y_.past_last() - y_.first()};
  }
  Patch patch() const {
    const Box b = box();
    Patch patch{b.x0, b.y0, b.w, b.h, {}};
    patch.posts.resize(static_cast<std::size_t>(patch.w) * static_cast<std::size_t>(patch.h));
    return patch;
  }

 private:
  const RasterInfo& info_;
  const PostWindow& window_;
  bool pole_;
  std::shared_ptr<const Columns> columns_;  // of a geographic file
  std::vector<double> ys_;
  std::vector<PostXY> places_;  // of a polar file, each computed once
  Range x_, y_;
};

// Tiles of one product leave a gap of a post between them. Where posts lie between the file's, the kernel would find no
// neighbours there, so posts that the patch lacks are taken from the tiles beside it that continue its grid.
void PostSource::close_gaps(int source, Patch& patch) const {
  const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
  if (info.projection() != Projection::geographic || info.wraps_longitude) return;
  if (std::none_of(patch.posts.begin(), patch.posts.end(), [](float h) { return std::isnan(h); })) return;
  const Footprint& f = info.footprint;
  const auto& grid = std::get<GeographicGrid>(info.grid);
  for (const int other :
       catalogue_.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, 4 * widest_post_deg(info))) {
    const RasterInfo& tile = catalogue_.rasters()[static_cast<std::size_t>(other)];
    const auto* beside = std::get_if<GeographicGrid>(&tile.grid);
    if (other == source || !beside || std::abs(beside->lat_posts_per_degree / grid.lat_posts_per_degree - 1) > 1e-9 ||
        std::abs(beside->lon_posts_per_degree / grid.lon_posts_per_degree - 1) > 1e-9)
      continue;
    const double dx = std::remainder((tile.footprint.west_deg - f.west_deg) * grid.lon_posts_per_degree,
                                     360 * grid.lon_posts_per_degree);
    const double dy = (f.north_deg - tile.footprint.north_deg) * grid.lat_posts_per_degree;
    if (std::abs(dx - std::round(dx)) > 1e-3 || std::abs(dy - std::round(dy)) > 1e-3) continue;
    const int ix = static_cast<int>(std::lround(dx)), iy = static_cast<int>(std::lround(dy));
    const int x0 = std::max(patch.x0, ix), x1 = std::min(patch.x0 + patch.w, ix + tile.width);
    const int y0 = std::max(patch.y0, iy), y1 = std::min(patch.y0 + patch.h, iy + tile.height);
    if (x0 >= x1 || y0 >= y1) continue;
    Patch piece{x0, y0, x1 - x0, y1 - y0,
                UninitialisedVector<float>(static_cast<std::size_t>(x1 - x0) * static_cast<std::size_t>(y1 - y0))};
    read(other, x0 - ix, y0 - iy, piece.w, piece.h, piece.posts.data());
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x)
        if (std::isnan(patch.at(x, y))) patch.at(x, y) = piece.at(x, y);
  }
}

// The window's posts that a layer may still fill, in whose order they lie in the file.
class PostSource::Filling {
 public:
  Filling(int source, std::size_t offset, int window_cols, const Strip& strip)
      : mark_(static_cast<SourceMark>(source)),
        cols_(static_cast<std::size_t>(window_cols)),
        heights_(strip.heights + offset),
        sources_(strip.sources + offset) {}

  // Heights of `n` posts of one row.
  void row(int r, int first, const float* heights, int n) {
    const std::size_t at = index(r, first);
    const Taken taken = take_row(heights, n, mark_, heights_ + at, sources_ + at);
    filled_ += static_cast<std::size_t>(taken.filled), impossible_ += static_cast<std::size_t>(taken.impossible);
  }

  bool wanted(int r, int c) const { return sources_[index(r, c)] == kNoSource; }
  void post(int r, int c, float h, SourceMark flag) {
    if (std::isnan(h)) return;
    if (h < kLowestRelief_m || h > kHighestRelief_m) {
      ++impossible_;
      return;
    }
    heights_[index(r, c)] = h, sources_[index(r, c)] = mark_ | flag;
    ++filled_;
  }

  std::size_t filled() const { return filled_; }
  std::size_t impossible() const { return impossible_; }

 private:
  std::size_t index(int r, int c) const { return static_cast<std::size_t>(r) * cols_ + static_cast<std::size_t>(c); }
  SourceMark mark_;
  std::size_t cols_, filled_ = 0, impossible_ = 0;
  float* heights_;
  SourceMark* sources_;
};

// Rows of a patch, interpolated at places along them. Each is wanted for a few rows of the window that follow each
// other.
class PostSource::AlongRows {
 public:
  AlongRows(const Patch& patch, const Columns& columns) : patch_(patch), columns_(columns) {
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
  const Patch& patch_;
  const Columns& columns_;
  std::array<int, 4> rows_;  // whose values are here, by their number modulo 4
  std::array<UninitialisedVector<double>, 4> values_;
};

// A geographic file's rows and columns are separable: a row of the window is some posts of a row of the file, or four
// such rows, interpolated along themselves, with the row's weights.
void PostSource::fill_rows(const Patch& patch, const Columns& all_columns, const Part& rows, Filling& filling) {
  const Part& columns = *all_columns.part;
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

namespace {

// Whether all of the window's posts are posts of the file's lattice.
bool copied_from(const RasterInfo& info, const PostWindow& w) {
  if (!info.lattice_level) return false;
  if (*info.lattice_level > kTickLevel) return true;
  const std::int64_t step = std::int64_t{1} << (kTickLevel - *info.lattice_level);
  return w.lat0 % step == 0 && w.lon0 % step == 0 && w.lat_step % step == 0 && w.lon_step % step == 0;
}

}  // namespace

// Writes the layer's valid posts where there is none yet. Returns how many.
std::size_t PostSource::add_layer(int source, const PostWindow& window, std::size_t offset, Reach reach,
                                  const Strip& strip) const {
  const Mapping mapping(catalogue_.rasters()[static_cast<std::size_t>(source)], source, window, *strip.columns);
  Patch patch = mapping.patch();
  if (patch.w == 0) return 0;
  try {
    read(source, patch.x0, patch.y0, patch.w, patch.h, patch.posts.data());
    if (!copied_from(catalogue_.rasters()[static_cast<std::size_t>(source)], window)) close_gaps(source, patch);
  } catch (const DataError& error) {
    if (!fall_through_) throw;
    {
      const std::lock_guard lock(replaced_mutex_);
      strip.replaced->push_back(static_cast<SourceIndex>(source));
    }
    warn_(error.file(), error.what());
    return 0;
  }
  Filling filling(source, offset, window.cols, strip);
  const Columns* columns = mapping.columns();
  const std::optional<Part> rows = mapping.rows();
  if (reach == Reach::between_posts && columns && rows) {
    fill_rows(patch, *columns, *rows, filling);
  } else {
    for (int r = 0; r < window.rows; ++r)
      for (int c = 0; c < mapping.cols(); ++c) {
        if (!filling.wanted(r, c)) continue;
        const PostXY q = mapping.at(r, c);
        if (q.x < patch.x0 + 1 || q.y < patch.y0 + 1 || q.x > patch.x0 + patch.w - 3 || q.y > patch.y0 + patch.h - 3)
          continue;
        if (reach == Reach::between_posts)
          filling.post(r, c, interpolate(patch, Place(q.x), Place(q.y)), 0);
        else
          filling.post(r, c, extended(patch, q.x, q.y), kFilledBit);
      }
  }
  if (filling.impossible() > 0) {
    const std::string& path = catalogue_.rasters()[static_cast<std::size_t>(source)].path;
    warn_(path, fmt::format("{}: posts outside of {} .. {} m taken as voids", path, kLowestRelief_m, kHighestRelief_m));
  }
  if (mapping.pole() && strip.sources[offset] != kNoSource) {
    std::fill_n(strip.heights + offset, window.cols, strip.heights[offset]);
    std::fill_n(strip.sources + offset, window.cols, strip.sources[offset]);
  }
  return filling.filled();
}

void PostSource::join(const PostWindow& part, std::size_t offset, const Strip& strip, const StopToken& stop) const {
  const auto compose_line = [&](const PostWindow& line) {
    std::vector<float> heights(line.size());
    std::vector<SourceMark> marks(line.size());
    ColumnsOfFiles columns;
    compose_strip(line, {0, line.rows, heights.data(), marks.data(), strip.replaced, &columns, strip.files, false},
                  stop);
    return heights;
  };
  join_levels(borders_, part, compose_line, strip.sources + offset, strip.heights + offset);
}

// A file that shares posts of a part with the layers beneath.
struct PostSource::Blending {
  int source, beneath;  // `beneath`: so many files are coarser
  Mapping mapping;
  LayerEdges::Shares shares;
};

void PostSource::blend(const PostWindow& part, std::size_t offset, const Strip& strip, const StopToken& stop) const {
  const SourceMark* marks = strip.sources + offset;
  const std::size_t count = part.lat0 == 0 || part.lat0 == kLatTicks ? 1 : part.size();
  std::vector<SourceIndex> present, unusable;
  for (std::size_t i = 0; i < count; i += count_equal(marks + i, count - i))
    if (const SourceIndex s = source_of(marks[i]); s != kNoSource &&
                                                   std::find(present.begin(), present.end(), s) == present.end() &&
                                                   edges_.meets(static_cast<int>(s)))
      present.push_back(s);
  if (present.empty()) return;
  std::sort(present.begin(), present.end());
  std::vector<Blending> sources;
  for (const SourceIndex s : present) {
    const int source = static_cast<int>(s);
    Mapping mapping(catalogue_.rasters()[s], source, part, *strip.columns);
    const Mapping::Box box = mapping.box();
    if (auto shares = edges_.shares(source, box.x0, box.y0, box.w, box.h, unusable))
      sources.push_back({source, catalogue_.layer_begin(source), std::move(mapping), std::move(*shares)});
  }
  if (!unusable.empty()) {
    const std::lock_guard lock(replaced_mutex_);
    strip.replaced->insert(strip.replaced->end(), unusable.begin(), unusable.end());
  }
  for (auto first = sources.begin(); first != sources.end();) {
    const auto past =
        std::find_if(first, sources.end(), [&](const Blending& b) { return b.beneath != first->beneath; });
    blend_layer(part, offset, strip, {first, past}, stop);
    first = past;
  }
}

// Files of one layer.
void PostSource::blend_layer(const PostWindow& part, std::size_t offset, const Strip& strip,
                             std::span<Blending> sources, const StopToken& stop) const {
  struct Shared {
    std::size_t at;
    double share;
  };
  const bool pole = sources.front().mapping.pole();
  const int cols = sources.front().mapping.cols();
  std::vector<Shared> shared;
  for (int r = 0; r < part.rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const std::size_t at =
          static_cast<std::size_t>(r) * static_cast<std::size_t>(part.cols) + static_cast<std::size_t>(c);
      const auto source = static_cast<int>(source_of(strip.sources[offset + at]));
      const auto found =
          std::find_if(sources.begin(), sources.end(), [&](const Blending& b) { return b.source == source; });
      if (found == sources.end()) continue;
      const PostXY q = found->mapping.at(r, c);
      if (const double share = found->shares.at(q.x, q.y); share > 0) shared.push_back({at, share});
    }
  if (shared.empty()) return;
  // What lies beneath the rows that share.
  const auto columns = static_cast<std::size_t>(part.cols);
  const int first = static_cast<int>(shared.front().at / columns), last = static_cast<int>(shared.back().at / columns);
  PostWindow rows = part;
  rows.lat0 += static_cast<std::int64_t>(first) * part.lat_step, rows.rows = last - first + 1;
  std::vector<float> heights(rows.size(), kNaN);
  std::vector<SourceMark> marks(rows.size(), kNoSource);
  compose_part(rows, 0,
               {0, rows.rows, heights.data(), marks.data(), strip.replaced, strip.columns, sources.front().beneath,
                strip.joined},
               stop);
  constexpr double kWhole = 1 - 1e-6;  // of the layer beneath: rounding
  for (const Shared& s : shared) {
    const std::size_t here = offset + s.at, there = s.at - static_cast<std::size_t>(first) * columns;
    const float below = heights[there];
    if (std::isnan(below)) continue;
    const auto own = static_cast<double>(strip.heights[here]);
    strip.heights[here] =
        s.share > kWhole ? below : static_cast<float>(own + s.share * (static_cast<double>(below) - own));
    strip.sources[here] |= (marks[there] & kMarkBits) | kBlendedBit;
  }
  if (pole) {
    std::fill_n(strip.heights + offset, part.cols, strip.heights[offset]);
    std::fill_n(strip.sources + offset, part.cols, strip.sources[offset]);
  }
}

namespace {

// What several strips have added.
void settle(std::vector<SourceIndex>& replaced) {
  std::sort(replaced.begin(), replaced.end());
  replaced.erase(std::unique(replaced.begin(), replaced.end()), replaced.end());
}

// use(post), row by row, for each void that can be filled. A tile looks beyond itself: nothing is written before all
// have looked.
template <typename Mark, typename Use>
void for_filled(const PostWindow& window, const float* heights, const Mark& mark, const std::vector<char>& has_voids,
                const StopToken& stop, Use&& use) {
  constexpr int kSide = TileOfVoids::kSide;
  const auto down = static_cast<std::size_t>((window.rows + kSide - 1) / kSide);
  std::vector<std::vector<FilledPost>> filled(down);
  in_parallel(down, [&](std::size_t strip) {
    stop.check();
    const int first = static_cast<int>(strip) * kSide, past_last = std::min(first + kSide, window.rows);
    if (std::none_of(has_voids.begin() + first, has_voids.begin() + past_last, [](char any) { return any; })) return;
    for (int column = 0; column < window.cols; column += kSide) {
      const std::vector<FilledPost> tile = TileOfVoids(window, heights, first, column).filled(mark);
      filled[strip].insert(filled[strip].end(), tile.begin(), tile.end());
    }
    std::sort(filled[strip].begin(), filled[strip].end(),
              [](const FilledPost& a, const FilledPost& b) { return a.at < b.at; });
  });
  for (const std::vector<FilledPost>& strip : filled)
    for (const FilledPost& post : strip) use(post);
}

}  // namespace

Posts PostSource::compose(const PostWindow& window, const StopToken& stop) const {
  return compose(window, static_cast<int>(catalogue_.rasters().size()), stop);
}

Posts PostSource::compose(const PostWindow& window, int number, const StopToken& stop) const {
  Posts posts;
  ColumnsOfFiles files;
  posts.heights.resize(window.size());
  posts.sources.resize(window.size());
  for_strips(window, stop, [&](int first, int rows) {
    const std::size_t at = static_cast<std::size_t>(first) * static_cast<std::size_t>(window.cols);
    compose_strip(
        window,
        {first, first + rows, posts.heights.data() + at, posts.sources.data() + at, &posts.replaced, &files, number},
        stop);
  });
  settle(posts.replaced);
  return posts;
}

void PostSource::compose_filled(const PostWindow& window, PostGridRows& grid, const StopToken& stop) const {
  const auto columns = static_cast<std::size_t>(window.cols);
  grid.heights.resize(window.size());
  grid.sources.reset(window.rows, window.cols);
  grid.replaced.clear();
  std::vector<char> has_voids(static_cast<std::size_t>(window.rows));
  ColumnsOfFiles files;
  for_strips(window, stop, [&](int first, int rows) {
    // Looked at while they are in the nearest caches.
    UninitialisedVector<SourceMark> marks(static_cast<std::size_t>(rows) * columns);
    float* heights = grid.heights.data() + static_cast<std::size_t>(first) * columns;
    compose_strip(window,
                  {first, first + rows, heights, marks.data(), &grid.replaced, &files,
                   static_cast<int>(catalogue_.rasters().size())},
                  stop);
    for (int r = 0; r < rows; ++r) {
      const std::size_t at = static_cast<std::size_t>(r) * columns;
      grid.sources.set(first + r, marks.data() + at);
      has_voids[static_cast<std::size_t>(first + r)] = any_void(heights + at, window.cols);
    }
  });
  settle(grid.replaced);

  const auto mark = [&](std::size_t at) {
    return grid.sources.mark(static_cast<int>(at / columns), static_cast<int>(at % columns));
  };
  std::vector<SourceMark> row_marks(columns);
  int row = -1;  // whose marks those are
  const auto keep_row = [&] {
    if (row >= 0) grid.sources.set(row, row_marks.data());
  };
  for_filled(window, grid.heights.data(), mark, has_voids, stop, [&](const FilledPost& post) {
    const auto r = static_cast<int>(post.at / columns);
    if (r != row) {
      keep_row();
      row = r;
      grid.sources.expand(row, row_marks.data());
    }
    grid.heights[post.at] = post.height_m, row_marks[post.at % columns] = post.source;
  });
  keep_row();
}

void PostSource::fill_voids(const PostWindow& window, Posts& posts, const StopToken& stop) {
  const std::vector<char> has_voids(static_cast<std::size_t>(window.rows), 1);
  for_filled(
      window, posts.heights.data(), [&](std::size_t at) { return posts.sources[at]; }, has_voids, stop,
      [&](const FilledPost& post) { posts.heights[post.at] = post.height_m, posts.sources[post.at] = post.source; });
}

}  // namespace selenograph::dem
