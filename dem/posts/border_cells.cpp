#include "dem/posts/border_cells.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "dem/base/error.h"

namespace selenograph::dem {
namespace {

constexpr int kTileCells = 64;   // cells along each side of a tile
constexpr int kCellSamples = 4;  // samples along each side of a cell
constexpr int kRowsRead = 64;    // rows of posts per read
// Limits of the cache; it is emptied when either is reached.
constexpr std::size_t kMaxTilesHeld = std::size_t{1} << 18;
constexpr std::size_t kMaxCellsHeld = std::size_t{1} << 22;  // 100 MB

bool is_valid(float height_m) { return height_m >= kLowestRelief_m && height_m <= kHighestRelief_m; }

}  // namespace

// Cached result for one tile of kTileCells x kTileCells cells.
struct BorderCells::Tile {
  std::vector<BorderCell> cells{};
  std::vector<SourceIndex> unusable{};
};

// Samples of a tile, with a margin of one row or column on each side, in which is_border() finds neighbours.
struct BorderCells::SampleGrid {
  const LayerSheet& sheet;
  int per_cell, side;
  std::int64_t stride, x0, y0;  // stride in posts; the first sample's position in the sheet
  std::vector<float> heights_m;
  std::vector<int> sources;  // file of each sample; -1: no valid post

  SampleGrid(const LayerSheet& of, int octave, std::int64_t column, std::int64_t row)
      : sheet(of),
        per_cell(static_cast<int>(std::min<std::int64_t>(std::int64_t{1} << octave, kCellSamples))),
        side(kTileCells * per_cell + 2),
        stride((std::int64_t{1} << octave) / per_cell),
        x0(column * kTileCells * (std::int64_t{1} << octave) - stride),
        y0(row * kTileCells * (std::int64_t{1} << octave) - stride),
        heights_m(count(), std::numeric_limits<float>::quiet_NaN()),
        sources(count(), -1) {}
  std::size_t count() const { return static_cast<std::size_t>(side) * static_cast<std::size_t>(side); }
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(side) + static_cast<std::size_t>(c);
  }
  std::int64_t x(int c) const { return x0 + c * stride; }
  std::int64_t y(int r) const { return y0 + r * stride; }
  // Returns true if the coarser surface shows at a sample. Rows that end at a pole have no border there: no surface
  // lies beyond it.
  bool is_open(int r, int c) const { return sources[index(r, c)] < 0 && !sheet.is_beyond_pole(y(r)); }
  // Returns true for a valid sample with an open one among its four neighbours.
  bool is_border(int r, int c) const {
    return sources[index(r, c)] >= 0 &&
           (is_open(r, c - 1) || is_open(r, c + 1) || is_open(r - 1, c) || is_open(r + 1, c));
  }
};

// Border sample, at a post of the sheet.
struct BorderCells::BorderSample {
  int source;
  std::int64_t x, y;  // column and row in the sheet
  float height_m;
  float beneath_m = 0;
  SourceIndex beneath = kNoSource;
};

BorderCells::BorderCells(const Catalogue& catalogue, const LayerGroups& groups, ReadPosts read, HeightsBeneath beneath,
                         bool fall_through)
    : catalogue_(catalogue),
      groups_(groups),
      read_(std::move(read)),
      beneath_(std::move(beneath)),
      fall_through_(fall_through) {}

BorderCells::~BorderCells() = default;

// Reads a rectangle of a file's posts. Returns false, and reports the file, if it is unreadable and `fall_through_`.
bool BorderCells::read_or_report(int source, std::int64_t x0, std::int64_t y0, int w, int h,
                                 std::vector<float>& heights_m, std::vector<SourceIndex>& unusable) const {
  heights_m.resize(static_cast<std::size_t>(w) * static_cast<std::size_t>(h));
  try {
    read_(source, static_cast<int>(x0), static_cast<int>(y0), w, h, heights_m.data());
    return true;
  } catch (const DataError&) {
    if (!fall_through_) throw;
    unusable.push_back(static_cast<SourceIndex>(source));
    return false;
  }
}

// Reads the samples that lie in a file.
void BorderCells::read_samples(int source, SampleGrid& s, std::vector<SourceIndex>& unusable) const {
  const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
  const auto [shift_x, shift_y] = groups_.shift[static_cast<std::size_t>(source)];
  const bool wraps = info.wraps_longitude;
  std::vector<float> heights_m;
  // Test the file's position shifted by a turn around the globe, too: a tile may lie across the date line.
  for (const std::int64_t turn : {-1, 0, 1}) {
    if (turn != 0 && (s.sheet.globe == 0 || wraps)) continue;
    // Column and row, in the file, of the first sample. Sample i lies at first + i * stride.
    const std::int64_t first_x = s.x0 - shift_x + turn * s.sheet.globe, first_y = s.y0 - shift_y;
    // Return the range of samples, first and past the last, that lie in a file of `size` posts along an axis.
    const auto from = [&](std::int64_t first) { return std::max<std::int64_t>(0, -floor_div(first, s.stride)); };
    const auto to = [&](std::int64_t first, std::int64_t size) {
      return std::clamp<std::int64_t>(floor_div(size - 1 - first, s.stride) + 1, 0, s.side);
    };
    const std::int64_t x_from = wraps ? 0 : from(first_x), x_to = wraps ? s.side : to(first_x, info.width);
    const std::int64_t y_from = from(first_y), y_to = to(first_y, info.height);
    if (x_from >= x_to || y_from >= y_to) continue;
    const auto w = static_cast<int>((x_to - x_from - 1) * s.stride + 1);
    const std::int64_t rows_at_once = s.stride == 1 ? kRowsRead : 1;
    for (std::int64_t y = y_from; y < y_to; y += rows_at_once) {
      const auto h = static_cast<int>(std::min(rows_at_once, y_to - y));
      if (!read_or_report(source, first_x + x_from * s.stride, first_y + y * s.stride, w, h, heights_m, unusable))
        return;
      for (int r = 0; r < h; ++r)
        for (std::int64_t x = x_from; x < x_to; ++x) {
          const float height_m = heights_m[static_cast<std::size_t>(r) * static_cast<std::size_t>(w) +
                                           static_cast<std::size_t>((x - x_from) * s.stride)];
          if (!is_valid(height_m)) continue;
          const std::size_t sample = s.index(static_cast<int>(y) + r, static_cast<int>(x));
          s.heights_m[sample] = height_m;
          s.sources[sample] = source;
        }
    }
  }
}

// Returns the border samples of a tile, each with the coarser layers' height below it. Samples without coarser data are
// dropped.
std::vector<BorderCells::BorderSample> BorderCells::border_samples(const Key& key,
                                                                   std::vector<SourceIndex>& unusable) const {
  const auto [sheet_index, octave, column, row] = key;
  const LayerSheet& sheet = groups_.sheets[static_cast<std::size_t>(sheet_index)];
  SampleGrid s(sheet, octave, column, row);
  for (const int source : sheet.sources) read_samples(source, s, unusable);
  std::vector<BorderSample> found;
  for (int r = 1; r + 1 < s.side; ++r)  // without the margin
    for (int c = 1; c + 1 < s.side; ++c)
      if (s.is_border(r, c)) found.push_back({s.sources[s.index(r, c)], s.x(c), s.y(r), s.heights_m[s.index(r, c)]});
  std::vector<Geographic> positions;
  positions.reserve(found.size());
  for (const BorderSample& post : found)
    positions.push_back(sheet.position_at(static_cast<double>(post.x), static_cast<double>(post.y)));
  std::vector<float> beneath_m(found.size());
  std::vector<SourceIndex> sources(found.size());
  if (!found.empty()) beneath_(positions, sheet.layer_begin, beneath_m.data(), sources.data(), unusable);
  for (std::size_t i = 0; i < found.size(); ++i) {
    found[i].beneath_m = beneath_m[i];
    found[i].beneath = sources[i];
  }
  std::erase_if(found, [](const BorderSample& post) { return std::isnan(post.beneath_m); });
  return found;
}

// Returns a tile from the cache, or makes it.
std::shared_ptr<const BorderCells::Tile> BorderCells::tile(const Key& key) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = tiles_.find(key); found != tiles_.end()) return found->second;
  }
  // Make the tile without the lock: two threads may make the same one, with equal contents, and the first is cached.
  std::shared_ptr<const Tile> made = make_tile(key);
  const std::lock_guard lock(mutex_);
  if (tiles_.size() >= kMaxTilesHeld || cells_held_ >= kMaxCellsHeld) {
    tiles_.clear();
    cells_held_ = 0;
  }
  const auto [entry, is_new] = tiles_.emplace(key, std::move(made));
  if (is_new) cells_held_ += entry->second->cells.size();
  return entry->second;
}

namespace {

// Sums of steps per cell. Sums round differently in another order, so callers add samples in a fixed order.
class CellSums {
 public:
  // Adds the mean step of `samples` samples to cell (x, y).
  void add(std::int64_t x, std::int64_t y, double step_m, double samples) {
    Sum& sum = sums_[{y, x}];
    sum.step_m += step_m * samples;
    sum.samples += samples;
  }
  std::vector<BorderCell> cells() const {
    std::vector<BorderCell> cells;
    for (const auto& [row_column, sum] : sums_)
      cells.push_back({row_column.second, row_column.first, static_cast<float>(sum.step_m / sum.samples),
                       static_cast<float>(sum.samples)});
    return cells;
  }

 private:
  struct Sum {
    double step_m = 0, samples = 0;
  };
  std::map<std::pair<std::int64_t, std::int64_t>, Sum> sums_;  // by row and column
};

}  // namespace

// Makes a tile. In cells of 2 or 4 posts all posts are samples: then merges the four tiles of the finer octave, which
// have read the same posts already. Otherwise reads the samples.
std::shared_ptr<const BorderCells::Tile> BorderCells::make_tile(const Key& key) const {
  const auto [sheet, octave, column, row] = key;
  const std::int64_t cell = std::int64_t{1} << octave;
  auto made = std::make_shared<Tile>();
  CellSums sums;
  if (octave == 0 || cell > kCellSamples) {
    for (const BorderSample& post : border_samples(key, made->unusable))
      sums.add(floor_div(post.x, cell), floor_div(post.y, cell),
               static_cast<double>(post.height_m) - static_cast<double>(post.beneath_m), 1);
  } else {
    for (const int dy : {0, 1})
      for (const int dx : {0, 1}) {
        const std::shared_ptr<const Tile> quarter = tile({sheet, octave - 1, 2 * column + dx, 2 * row + dy});
        made->unusable.insert(made->unusable.end(), quarter->unusable.begin(), quarter->unusable.end());
        for (const BorderCell& c : quarter->cells)
          sums.add(floor_div(c.x, 2), floor_div(c.y, 2), static_cast<double>(c.step_m), static_cast<double>(c.samples));
      }
  }
  made->cells = sums.cells();
  return made;
}

std::vector<BorderCell> BorderCells::cells_in(int sheet, int octave, const CellRegion& region,
                                              std::vector<SourceIndex>& unusable) const {
  std::vector<BorderCell> found;
  for (std::int64_t row = floor_div(region.y0, kTileCells); row <= floor_div(region.y1 - 1, kTileCells); ++row)
    for (std::int64_t column = floor_div(region.x0, kTileCells); column <= floor_div(region.x1 - 1, kTileCells);
         ++column) {
      const std::shared_ptr<const Tile> cells = tile({sheet, octave, column, row});
      unusable.insert(unusable.end(), cells->unusable.begin(), cells->unusable.end());
      for (const BorderCell& c : cells->cells)
        if (c.x >= region.x0 && c.x < region.x1 && c.y >= region.y0 && c.y < region.y1) found.push_back(c);
    }
  return found;
}

std::vector<BorderPost> BorderCells::posts_in(int sheet, int octave, const CellRegion& region) const {
  std::vector<BorderPost> found;
  std::vector<SourceIndex> unusable;
  for (std::int64_t row = floor_div(region.y0, kTileCells); row <= floor_div(region.y1 - 1, kTileCells); ++row)
    for (std::int64_t column = floor_div(region.x0, kTileCells); column <= floor_div(region.x1 - 1, kTileCells);
         ++column)
      for (const BorderSample& post : border_samples({sheet, octave, column, row}, unusable)) {
        const auto [x, y] = groups_.post_in_file(catalogue_, post.source, post.x, post.y);
        found.push_back({post.source, x, y, post.height_m - post.beneath_m, post.beneath});
      }
  return found;
}

}  // namespace selenograph::dem
