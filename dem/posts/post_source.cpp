#include "dem/posts/post_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "dem/base/error.h"
#include "dem/base/parallel.h"
#include "dem/grid/grid_shift.h"
#include "dem/posts/layer_filling.h"
#include "dem/posts/raster_pool.h"
#include "dem/posts/tile_of_voids.h"

namespace selenograph::dem {

namespace {

constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();

}  // namespace

PostSource::PostSource(const Catalogue& catalogue, bool fall_through, Warn warn)
    : catalogue_(catalogue),
      fall_through_(fall_through),
      warn_(std::move(warn)),
      pool_(std::make_unique<RasterPool>(catalogue)),
      bends_(
          catalogue, [this](int source, int x0, int y0, int w, int h, float* m) { read(source, x0, y0, w, h, m); },
          [this](std::span<const Geographic> positions, int files, float* m, SourceIndex* sources,
                 std::vector<SourceIndex>& unusable) { heights_at(positions, files, m, sources, unusable); },
          fall_through),
      borders_(catalogue) {
  for (const RasterInfo& info : catalogue.rasters()) post_deg_ = std::max(post_deg_, widest_post_deg(info));
}

PostSource::~PostSource() = default;

// Before heights are interpolated: a kernel would spread an undeclared void over its neighbours.
void PostSource::read(int source, int x0, int y0, int w, int h, float* heights_m) const {
  pool_->with(source, [&](Raster& raster) { raster.read(x0, y0, w, h, heights_m); });
  const std::size_t count = static_cast<std::size_t>(w) * static_cast<std::size_t>(h);
  if (!keep_ground({heights_m, count}, catalogue_.offset_m(source))) return;
  const std::string& path = catalogue_.rasters()[static_cast<std::size_t>(source)].path;
  warn_(path, fmt::format("{}: posts of -9999 m or outside of {} .. {} m taken as voids", path, kLowestRelief_m,
                          kHighestRelief_m));
}

// Rows of a window that one thread composes, and the arrays that receive their posts, row by row.
struct PostSource::Strip {
  int first_row, past_last_row;
  float* heights;  // m
  SourceMark* sources;
  // Shared by all strips of the window.
  std::vector<SourceIndex>* replaced;  // unusable files that a coarser layer replaced
  ColumnsOfFiles* columns;
  int files;           // only the catalogue's first `files` files contribute posts
  bool joined = true;  // heights join the triangles of coarser posts (level_borders.h)
};

// Calls compose_rows(first_row, rows) for strips of a window, in parallel. Strips keep reads small. Their limits do not
// affect the result.
template <typename ComposeRows>
void PostSource::for_strips(const PostWindow& window, const StopToken& stop, ComposeRows&& compose_rows) const {
  constexpr int kStripRows = TileOfVoids::kSide, kFewRows = 256;
  const int strip_rows = window.rows <= kFewRows ? window.rows : kStripRows;
  in_parallel(static_cast<std::size_t>((window.rows + strip_rows - 1) / strip_rows), [&](std::size_t strip) {
    stop.check();
    const int first = static_cast<int>(strip) * strip_rows;
    compose_rows(first, std::min(strip_rows, window.rows - first));
  });
}

namespace {

// Position of a row of a window among the poles, from south to north.
enum class PolarZone { beyond_south, south_pole, between_poles, north_pole, beyond_north };

PolarZone polar_zone_of(std::int64_t lat_tick) {
  if (lat_tick < 0) return PolarZone::beyond_south;
  if (lat_tick == 0) return PolarZone::south_pole;
  if (lat_tick < kLatTicks) return PolarZone::between_poles;
  return lat_tick == kLatTicks ? PolarZone::north_pole : PolarZone::beyond_north;
}

// Fills a pole that no file holds: tiles of one product end a post before the south pole. All columns of the row `pole`
// are this one point. They get the mean of the valid posts among 16 on the next row, which do not depend on the window,
// and the source of the first of these; if none is valid, the row stays as it is. Returns the unusable files that a
// coarser layer replaced on the next row.
std::vector<SourceIndex> fill_pole(const PostSource& source, const PostWindow& pole, float* heights,
                                   SourceMark* sources) {
  PostWindow ring = pole;
  ring.lat0 = pole.lat0 == 0 ? pole.lat_step : pole.lat0 - pole.lat_step;
  ring.lon0 = 0;
  ring.cols = 16;
  ring.rows = 1;
  ring.lon_step = kLonTicks / ring.cols;
  const Posts ring_posts = source.compose(ring);
  double sum_m = 0;
  int valid = 0;
  SourceMark mark = kNoSource;
  for (std::size_t i = 0; i < ring_posts.heights.size(); ++i) {
    if (std::isnan(ring_posts.heights[i])) continue;
    if (valid == 0) mark = ring_posts.sources[i];
    ++valid;
    sum_m += static_cast<double>(ring_posts.heights[i]);
  }
  if (valid == 0) return ring_posts.replaced;
  std::fill_n(heights, pole.cols, static_cast<float>(sum_m / valid));
  std::fill_n(sources, pole.cols, mark | kFilledBit);
  return ring_posts.replaced;
}

}  // namespace

// Composes a strip's posts. Splits its rows into polar zones, each of which is composed as a window of its own. A row
// on a pole is one point: it takes the height that the finest layer has there, whatever the column.
void PostSource::compose_strip(const PostWindow& window, const Strip& strip, const StopToken& stop) const {
  const auto columns = static_cast<std::size_t>(window.cols);
  const std::size_t count = static_cast<std::size_t>(strip.past_last_row - strip.first_row) * columns;
  std::fill_n(strip.heights, count, kNaN);
  std::fill_n(strip.sources, count, kNoSource);
  const auto lat_tick_of = [&](int r) { return window.lat0 + r * window.lat_step; };
  const auto zone_of = [&](int r) { return polar_zone_of(lat_tick_of(r)); };
  for (int first_row = strip.first_row; first_row < strip.past_last_row;) {
    int past_row = first_row + 1;
    while (past_row < strip.past_last_row && zone_of(past_row) == zone_of(first_row)) ++past_row;
    PostWindow zone = window;
    zone.rows = past_row - first_row;
    zone.lat0 = lat_tick_of(first_row);
    const PolarZone polar_zone = zone_of(first_row);
    if (polar_zone == PolarZone::beyond_south || polar_zone == PolarZone::beyond_north) {
      // Reflect latitudes in the pole: rows continue on the opposite meridian, in the opposite direction.
      zone.lat0 = polar_zone == PolarZone::beyond_south ? -zone.lat0 : 2 * kLatTicks - zone.lat0;
      zone.lat_step = -zone.lat_step;
      zone.lon0 += kLonTicks / 2;
    }
    compose_zone(zone, static_cast<std::size_t>(first_row - strip.first_row) * columns, strip, stop);
    first_row = past_row;
  }
}

// Composes rows between the poles, or one row that is a pole: fills them from the files, bends them to meet finer
// layers, and joins them with coarser chunks.
void PostSource::compose_zone(const PostWindow& zone, std::size_t first_post, const Strip& strip,
                              const StopToken& stop) const {
  const bool pole = zone.lat0 == 0 || zone.lat0 == kLatTicks;
  const double south = lat_deg_of(std::min(zone.lat0, zone.lat0 + (zone.rows - 1) * zone.lat_step));
  const double north = lat_deg_of(std::max(zone.lat0, zone.lat0 + (zone.rows - 1) * zone.lat_step));
  const double west = static_cast<double>(zone.lon0) / kTicksPerDegree - 180;
  const double east = west + static_cast<double>(zone.cols - 1) * zone.lon_step / kTicksPerDegree;
  // Include files within a post of the zone: extrapolation reaches a post beyond a file's outermost posts, for example
  // to a pole that lies half a post beyond its last row.
  std::vector<int> layers = pole ? catalogue_.touching(south, north, -180, 180, post_deg_)
                                 : catalogue_.touching(south, north, west, east, post_deg_);
  layers.erase(std::lower_bound(layers.begin(), layers.end(), strip.files), layers.end());
  std::size_t missing = pole ? 1 : zone.size();  // posts without a height yet
  for (auto layer = layers.rbegin(); layer != layers.rend() && missing > 0; ++layer) {
    stop.check();
    missing -= add_layer(*layer, zone, first_post, Sampling::interpolate, strip);
  }
  // Extrapolate afterwards, from files whose posts are not on the lattice: interpolation needs four valid posts around
  // a position, so it leaves out the outermost positions of such a file.
  for (auto layer = layers.rbegin(); layer != layers.rend() && missing > 0; ++layer)
    if (!catalogue_.rasters()[static_cast<std::size_t>(*layer)].lattice_level)
      missing -= add_layer(*layer, zone, first_post, Sampling::extrapolate, strip);
  const std::vector<float> finer_distance_m = bend(zone, first_post, strip);
  if (strip.joined && !pole) join_levels_in(zone, first_post, strip, finer_distance_m, stop);
  const bool all_files = strip.files == static_cast<int>(catalogue_.rasters().size());
  if (pole && all_files && strip.sources[first_post] == kNoSource) {
    const std::vector<SourceIndex> replaced =
        fill_pole(*this, zone, strip.heights + first_post, strip.sources + first_post);
    const std::lock_guard lock(replaced_mutex_);
    strip.replaced->insert(strip.replaced->end(), replaced.begin(), replaced.end());
  }
}

namespace {

// Returns the position of a file's first post in columns and rows of `grid_file`; empty if their posts do not
// coincide. Unlike shift_between() it takes the shorter way around the globe, so that tiles on both sides of the date
// line count as neighbours.
std::optional<std::pair<std::int64_t, std::int64_t>> first_post_in(const RasterInfo& file,
                                                                   const RasterInfo& grid_file) {
  const auto* grid = std::get_if<GeographicGrid>(&grid_file.grid);
  if (!grid) return shift_between(grid_file.grid, file.grid);
  const auto* own_grid = std::get_if<GeographicGrid>(&file.grid);
  if (!own_grid || std::abs(own_grid->lat_posts_per_degree / grid->lat_posts_per_degree - 1) > 1e-9 ||
      std::abs(own_grid->lon_posts_per_degree / grid->lon_posts_per_degree - 1) > 1e-9)
    return std::nullopt;
  const double dx =
      std::remainder((file.footprint.west_deg - grid_file.footprint.west_deg) * grid->lon_posts_per_degree,
                     360 * grid->lon_posts_per_degree);
  const double dy = (grid_file.footprint.north_deg - file.footprint.north_deg) * grid->lat_posts_per_degree;
  if (std::abs(dx - std::round(dx)) > 1e-3 || std::abs(dy - std::round(dy)) > 1e-3) return std::nullopt;
  return std::pair{std::llround(dx), std::llround(dy)};
}

}  // namespace

// Fills missing posts of a patch of the file `source` from neighbouring tiles on the same grid. Tiles of one product
// leave a gap of a post between them, where the interpolation kernel would find no neighbours.
void PostSource::close_gaps(int source, PostPatch& patch) const {
  const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
  if (info.wraps_longitude) return;
  if (std::none_of(patch.posts.begin(), patch.posts.end(), [](float h) { return std::isnan(h); })) return;
  const Footprint& f = info.footprint;
  constexpr double kMarginPosts = 4;  // the gap of one post, and the patch's margin beyond the file (PostRange)
  for (const int neighbour :
       catalogue_.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, kMarginPosts * widest_post_deg(info))) {
    const RasterInfo& tile = catalogue_.rasters()[static_cast<std::size_t>(neighbour)];
    const auto first = neighbour == source ? std::nullopt : first_post_in(tile, info);
    if (!first) continue;
    // All columns and rows are those of the file `source`, until the tile is read.
    const int tile_x = static_cast<int>(first->first), tile_y = static_cast<int>(first->second);
    const int x0 = std::max(patch.x0, tile_x), x1 = std::min(patch.x0 + patch.w, tile_x + tile.width);
    const int y0 = std::max(patch.y0, tile_y), y1 = std::min(patch.y0 + patch.h, tile_y + tile.height);
    if (x0 >= x1 || y0 >= y1) continue;
    PostPatch overlap{
        x0, y0, x1 - x0, y1 - y0,
        UninitialisedVector<float>(static_cast<std::size_t>(x1 - x0) * static_cast<std::size_t>(y1 - y0))};
    read(neighbour, x0 - tile_x, y0 - tile_y, overlap.w, overlap.h, overlap.posts.data());
    for (int y = y0; y < y1; ++y)
      for (int x = x0; x < x1; ++x)
        if (std::isnan(patch.at(x, y))) patch.at(x, y) = overlap.at(x, y);
  }
}

namespace {

// Returns true if all of the window's posts are posts of the file's lattice: heights are then copied, not interpolated.
bool copied_from(const RasterInfo& info, const PostWindow& w) {
  if (!info.lattice_level) return false;
  if (*info.lattice_level > kTickLevel) return true;  // such a file has a post at every tick
  const std::int64_t step = std::int64_t{1} << (kTickLevel - *info.lattice_level);
  return w.lat0 % step == 0 && w.lon0 % step == 0 && w.lat_step % step == 0 && w.lon_step % step == 0;
}

}  // namespace

// Writes heights of the file `source` to the window's posts that have none yet. Returns the number of posts written.
std::size_t PostSource::add_layer(int source, const PostWindow& window, std::size_t first_post, Sampling sampling,
                                  const Strip& strip) const {
  const WindowMapping mapping(catalogue_.rasters()[static_cast<std::size_t>(source)], source, window, *strip.columns);
  PostPatch patch = mapping.patch();
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
  LayerFilling filling(source, window.cols, strip.heights + first_post, strip.sources + first_post);
  const FileColumns* columns = mapping.columns();
  const std::optional<AxisSpan> rows = mapping.rows();
  if (sampling == Sampling::interpolate && columns && rows) {
    fill_rows(patch, *columns, *rows, filling);
  } else {
    for (int r = 0; r < window.rows; ++r)
      for (int c = 0; c < mapping.cols(); ++c) {
        if (!filling.is_missing(r, c)) continue;
        const PostXY q = mapping.at(r, c);
        // Skip a position whose kernel, columns x - 1 to x + 2 and as many rows, leaves the patch.
        if (q.x < patch.x0 + 1 || q.y < patch.y0 + 1 || q.x > patch.x0 + patch.w - 3 || q.y > patch.y0 + patch.h - 3)
          continue;
        if (sampling == Sampling::interpolate)
          filling.add_post(r, c, interpolate(patch, PostPosition(q.x), PostPosition(q.y)), 0);
        else
          filling.add_post(r, c, extrapolate(patch, q.x, q.y), kFilledBit);
      }
  }
  // Only the first column of a pole was filled: repeat it along the row.
  if (mapping.pole() && strip.sources[first_post] != kNoSource) {
    std::fill_n(strip.heights + first_post, window.cols, strip.heights[first_post]);
    std::fill_n(strip.sources + first_post, window.cols, strip.sources[first_post]);
  }
  return filling.filled();
}

// Joins the zone's heights with the triangles of coarser chunks. The line of posts along a border is composed without
// being joined itself.
void PostSource::join_levels_in(const PostWindow& zone, std::size_t first_post, const Strip& strip,
                                std::span<const float> finer_distance_m, const StopToken& stop) const {
  const auto compose_line = [&](const PostWindow& line) {
    std::vector<float> heights(line.size());
    std::vector<SourceMark> marks(line.size());
    ColumnsOfFiles columns;
    compose_strip(line, {0, line.rows, heights.data(), marks.data(), strip.replaced, &columns, strip.files, false},
                  stop);
    return heights;
  };
  join_levels(borders_, zone, compose_line, {strip.sources + first_post, zone.size()}, finer_distance_m,
              strip.heights + first_post);
}

// Adds the bends of coarser layers to a zone's heights (layer_bends.h). Returns each post's distance from finer layers,
// m; empty if no band reaches the zone.
std::vector<float> PostSource::bend(const PostWindow& zone, std::size_t first_post, const Strip& strip) const {
  if (catalogue_.one_layer()) return {};
  const bool pole = zone.lat0 == 0 || zone.lat0 == kLatTicks;
  PositionGrid grid;
  grid.rows = zone.rows;
  grid.columns = pole ? 1 : zone.cols;
  grid.position = [&](int r, int c) {
    return Geographic{lat_deg_of(zone.lat0 + r * zone.lat_step), lon_deg_of(wrap_lon(zone.lon0 + c * zone.lon_step)),
                      0};
  };
  grid.sources = {strip.sources + first_post, pole ? 1 : zone.size()};
  Bends bends = bends_.bends_at(grid, files());
  if (!bends.unusable.empty()) {
    const std::lock_guard lock(replaced_mutex_);
    strip.replaced->insert(strip.replaced->end(), bends.unusable.begin(), bends.unusable.end());
  }
  for (std::size_t i = 0; i < bends.added_m.size(); ++i) {
    if (bends.added_m[i] == 0) continue;
    strip.heights[first_post + i] += bends.added_m[i];
    strip.sources[first_post + i] |= kBlendedBit;
  }
  if (pole && !bends.added_m.empty()) {
    std::fill_n(strip.heights + first_post, zone.cols, strip.heights[first_post]);
    std::fill_n(strip.sources + first_post, zone.cols, strip.sources[first_post]);
  }
  return std::move(bends.finer_distance_m);
}

// Writes the heights of the first `files` files, the coarser layers, at any positions, bent to meet each other (NaN: no
// data). LayerBends measures the steps at the border of a finer layer from them.
void PostSource::heights_at(std::span<const Geographic> positions, int files, float* heights_m, SourceIndex* sources,
                            std::vector<SourceIndex>& unusable) const {
  std::fill_n(heights_m, positions.size(), kNaN);
  std::fill_n(sources, positions.size(), kNoSource);
  PositionBox box;
  for (const Geographic& position : positions) box.add(position);
  std::vector<int> layers = catalogue_.touching(box.south_deg, box.north_deg, box.west_deg, box.east_deg, post_deg_);
  layers.erase(std::lower_bound(layers.begin(), layers.end(), files), layers.end());
  for (auto layer = layers.rbegin(); layer != layers.rend(); ++layer)
    add_heights(*layer, positions, heights_m, sources, unusable);
  PositionGrid grid;
  grid.rows = 1;
  grid.columns = static_cast<int>(positions.size());
  grid.position = [&](int, int c) { return positions[static_cast<std::size_t>(c)]; };
  grid.sources = {sources, positions.size()};
  const Bends bends = bends_.bends_at(grid, files);
  unusable.insert(unusable.end(), bends.unusable.begin(), bends.unusable.end());
  for (std::size_t i = 0; i < bends.added_m.size(); ++i) heights_m[i] += bends.added_m[i];
}

// Writes a file's heights at positions that have none yet. Posts are read as one rectangle around the positions: the
// list is halved until that has at most kMaxPostsAtOnce posts.
void PostSource::add_heights(int source, std::span<const Geographic> positions, float* heights_m, SourceIndex* sources,
                             std::vector<SourceIndex>& unusable) const {
  constexpr double kMaxPostsAtOnce = 1 << 18;
  const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
  std::vector<std::pair<std::size_t, PostXY>> missing;
  PostRange x_range, y_range;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (sources[i] != kNoSource) continue;
    PostXY p = locate(info, positions[i].lat_deg, positions[i].lon_deg);
    // Count columns of a global file from the first position on, so that the rectangle may cross its last column.
    if (info.wraps_longitude && !missing.empty())
      p.x -= info.width * std::round((p.x - missing.front().second.x) / info.width);
    if (!(p.x > -1 && p.y > -1 && p.y < info.height) || (!info.wraps_longitude && p.x >= info.width)) continue;
    x_range.add(p.x, 1e300);  // no limit: the columns are tested above, and a global file has none
    y_range.add(p.y, info.height);
    missing.emplace_back(i, p);
  }
  if (missing.empty()) return;
  constexpr double kMargins = 6;  // what PostRange adds on both sides together
  const double posts = (x_range.high - x_range.low + kMargins) * (y_range.high - y_range.low + kMargins);
  if (posts > kMaxPostsAtOnce && missing.size() > 1) {
    const std::size_t half = positions.size() / 2;
    add_heights(source, positions.first(half), heights_m, sources, unusable);
    add_heights(source, positions.subspan(half), heights_m + half, sources + half, unusable);
    return;
  }
  PostPatch patch{x_range.first(),
                  y_range.first(),
                  x_range.past_last() - x_range.first(),
                  y_range.past_last() - y_range.first(),
                  {}};
  patch.posts.resize(static_cast<std::size_t>(patch.w) * static_cast<std::size_t>(patch.h));
  try {
    read(source, patch.x0, patch.y0, patch.w, patch.h, patch.posts.data());
    close_gaps(source, patch);
  } catch (const DataError&) {
    if (!fall_through_) throw;
    unusable.push_back(static_cast<SourceIndex>(source));
    return;
  }
  for (const auto& [i, p] : missing) {
    float height_m = interpolate(patch, PostPosition(p.x), PostPosition(p.y));
    if (std::isnan(height_m) && !info.lattice_level) height_m = extrapolate(patch, p.x, p.y);
    if (!(height_m >= kLowestRelief_m && height_m <= kHighestRelief_m)) continue;
    heights_m[i] = height_m;
    sources[i] = static_cast<SourceIndex>(source);
  }
}

namespace {

// Sorts the files that strips added in any order, and drops repeats.
void sort_unique(std::vector<SourceIndex>& replaced) {
  std::sort(replaced.begin(), replaced.end());
  replaced.erase(std::unique(replaced.begin(), replaced.end()), replaced.end());
}

}  // namespace

Posts PostSource::compose(const PostWindow& window, const StopToken& stop) const {
  return compose(window, static_cast<int>(catalogue_.rasters().size()), stop);
}

Posts PostSource::compose(const PostWindow& window, int file_count, const StopToken& stop) const {
  Posts posts;
  ColumnsOfFiles files;
  posts.heights.resize(window.size());
  posts.sources.resize(window.size());
  for_strips(window, stop, [&](int first, int rows) {
    const std::size_t first_post = static_cast<std::size_t>(first) * static_cast<std::size_t>(window.cols);
    compose_strip(window,
                  {first, first + rows, posts.heights.data() + first_post, posts.sources.data() + first_post,
                   &posts.replaced, &files, file_count},
                  stop);
  });
  sort_unique(posts.replaced);
  return posts;
}

// Composes strips into the grid, compressing their source marks, then fills the voids of all strips.
void PostSource::compose_filled(const PostWindow& window, PostGridRows& grid, const StopToken& stop) const {
  const auto columns = static_cast<std::size_t>(window.cols);
  grid.heights.resize(window.size());
  grid.sources.reset(window.rows, window.cols);
  grid.replaced.clear();
  std::vector<char> has_voids(static_cast<std::size_t>(window.rows));
  ColumnsOfFiles files;
  for_strips(window, stop, [&](int first, int rows) {
    // Compress the strip's marks here, while they are in the core's caches.
    UninitialisedVector<SourceMark> marks(static_cast<std::size_t>(rows) * columns);
    float* heights = grid.heights.data() + static_cast<std::size_t>(first) * columns;
    compose_strip(window,
                  {first, first + rows, heights, marks.data(), &grid.replaced, &files,
                   static_cast<int>(catalogue_.rasters().size())},
                  stop);
    for (int r = 0; r < rows; ++r) {
      const std::size_t row_begin = static_cast<std::size_t>(r) * columns;
      grid.sources.set(first + r, marks.data() + row_begin);
      has_voids[static_cast<std::size_t>(first + r)] = any_void(heights + row_begin, window.cols);
    }
  });
  sort_unique(grid.replaced);

  const auto mark = [&](std::size_t index) {
    return grid.sources.mark(static_cast<int>(index / columns), static_cast<int>(index % columns));
  };
  // Filled posts come row by row: expand a row's runs of marks, change its marks, and compress it again.
  std::vector<SourceMark> row_marks(columns);
  int row = -1;  // row of `row_marks`; -1: none yet
  const auto store_row = [&] {
    if (row >= 0) grid.sources.set(row, row_marks.data());
  };
  for_each_filled(window, grid.heights.data(), mark, has_voids, stop, [&](const FilledPost& post) {
    const auto r = static_cast<int>(post.index / columns);
    if (r != row) {
      store_row();
      row = r;
      grid.sources.expand(row, row_marks.data());
    }
    grid.heights[post.index] = post.height_m;
    row_marks[post.index % columns] = post.source;
  });
  store_row();
}

void PostSource::fill_voids(const PostWindow& window, Posts& posts, const StopToken& stop) {
  const std::vector<char> has_voids(static_cast<std::size_t>(window.rows), 1);
  for_each_filled(
      window, posts.heights.data(), [&](std::size_t index) { return posts.sources[index]; }, has_voids, stop,
      [&](const FilledPost& post) {
        posts.heights[post.index] = post.height_m;
        posts.sources[post.index] = post.source;
      });
}

}  // namespace selenograph::dem
