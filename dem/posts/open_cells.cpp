#include "dem/posts/open_cells.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "dem/gdal/remote_names.h"

namespace selenograph::dem {
namespace {

constexpr int kTileCells = 64;
constexpr int kSamples = 4;                               // of a cell, along each side
constexpr std::size_t kMostTiles = std::size_t{1} << 18;  // some 150 MB
constexpr int kRowsRead = 64;

bool is_closed(char cover) { return cover >= ValidPosts::kInside; }

}  // namespace

// Open cells, a bit each.
struct CellTiles::Tile {
  bool any = false;
  std::array<std::uint64_t, kTileCells> rows{};
  std::vector<SourceIndex> unusable{};
};

// The posts of a sheet that a tile's cells are judged by.
struct CellTiles::Samples {
  const LayerSheet& sheet;
  int sheet_index;
  std::int64_t cell;                 // its side, in posts
  int per_cell, side;                // samples along a cell, along the tile
  std::int64_t stride;               // posts from sample to sample
  std::int64_t x0, y0;               // the tile's first post
  std::vector<Geographic> places{};  // of cells' middles
  double south_deg = 90, north_deg = -90, west_deg = 360, east_deg = -360;

  Samples(const LayerSheet& of, int index, int octave, std::int64_t column, std::int64_t row)
      : sheet(of),
        sheet_index(index),
        cell(std::int64_t{1} << octave),
        per_cell(static_cast<int>(std::min<std::int64_t>(cell, kSamples))),
        side(kTileCells * per_cell),
        stride(cell / per_cell),
        x0(column * kTileCells * cell),
        y0(row * kTileCells * cell) {
    for (int y = 0; y < kTileCells; ++y)
      for (int x = 0; x < kTileCells; ++x) {
        const double middle = static_cast<double>(cell - 1) / 2;
        const Geographic& p = places.emplace_back(
            sheet.place(static_cast<double>(x0 + x * cell) + middle, static_cast<double>(y0 + y * cell) + middle));
        south_deg = std::min(south_deg, p.lat_deg), north_deg = std::max(north_deg, p.lat_deg);
        west_deg = std::min(west_deg, p.lon_deg), east_deg = std::max(east_deg, p.lon_deg);
      }
    if (sheet.on_plane()) find_longitudes();
    south_deg = std::max(south_deg, -90.0), north_deg = std::min(north_deg, 90.0);
  }
  // On a plane longitudes are wrapped, and columns turn. A circle around a place that holds all others tells whether
  // they can be counted from there.
  void find_longitudes() {
    west_deg = -180, east_deg = 180;
    const Geographic& middle = places[places.size() / 2 + kTileCells / 2];
    const Vec3 toward = to_cartesian(middle).normalized();
    double cosine = 1, low = 0, high = 0;
    for (const Geographic& p : places) {
      cosine = std::min(cosine, toward.dot(to_cartesian(p)) / kMoonRadius_m);
      const double away_deg = std::remainder(p.lon_deg - middle.lon_deg, 360);
      low = std::min(low, away_deg), high = std::max(high, away_deg);
    }
    const double radius_deg = std::acos(std::max(cosine, -1.0)) * kDegreesPerRadian;
    if (std::abs(middle.lat_deg) + radius_deg < 90) west_deg = middle.lon_deg + low, east_deg = middle.lon_deg + high;
  }
  bool beyond_pole() const { return south_deg > north_deg; }
  // With a margin for posts that lie between those of other grids.
  double margin_deg() const { return 2 * static_cast<double>(cell) * widest_post_deg(*sheet.reference); }
};

CellTiles::CellTiles(const Catalogue& catalogue, const LayerGroups& groups, const ValidPosts& posts)
    : catalogue_(catalogue), groups_(groups), posts_(posts) {}

CellTiles::~CellTiles() = default;

std::shared_ptr<const CellTiles::Tile> CellTiles::tile(const Key& key) const {
  {
    const std::lock_guard lock(mutex_);
    if (const auto found = tiles_.find(key); found != tiles_.end()) return found->second;
  }
  // Whoever comes meanwhile makes it too, and finds the same.
  std::shared_ptr<const Tile> made = make_tile(key);
  const std::lock_guard lock(mutex_);
  if (tiles_.size() >= kMostTiles) tiles_.clear();
  return tiles_.emplace(key, std::move(made)).first->second;
}

// Cells all of whose posts are samples are open where all of their four parts are: no post is read again for them.
std::shared_ptr<const CellTiles::Tile> CellTiles::joined_tile(const Key& key) const {
  const auto [sheet, octave, column, row] = key;
  auto made = std::make_shared<Tile>();
  constexpr int kHalf = kTileCells / 2;
  for (const int down : {0, 1})
    for (const int along : {0, 1}) {
      const std::shared_ptr<const Tile> part = tile({sheet, octave - 1, 2 * column + along, 2 * row + down});
      made->unusable.insert(made->unusable.end(), part->unusable.begin(), part->unusable.end());
      for (int y = 0; part->any && y < kHalf; ++y) {
        const auto at = static_cast<std::size_t>(2 * y);
        const std::uint64_t both = part->rows[at] & part->rows[at + 1];
        for (int x = 0; both != 0 && x < kHalf; ++x)
          if ((both >> (2 * x) & 3) == 3) {
            made->any = true;
            made->rows[static_cast<std::size_t>(down * kHalf + y)] |= std::uint64_t{1} << (along * kHalf + x);
          }
      }
    }
  return made;
}

std::shared_ptr<const CellTiles::Tile> CellTiles::make_tile(const Key& key) const {
  const auto [sheet, octave, column, row] = key;
  if (octave > 0 && (std::int64_t{1} << octave) <= kSamples) return joined_tile(key);
  auto made = std::make_shared<Tile>();
  const Samples samples(groups_.sheets[static_cast<std::size_t>(sheet)], sheet, octave, column, row);
  if (samples.beyond_pole()) return made;
  const std::vector<int> touching = catalogue_.touching(samples.south_deg, samples.north_deg, samples.west_deg,
                                                        samples.east_deg, samples.margin_deg());
  std::vector<char> closed = closed_cells(samples, touching, made->unusable);
  if (!std::all_of(closed.begin(), closed.end(), is_closed)) open_over(samples, touching, std::move(closed), *made);
  return made;
}

// Those of which a sample is a valid post of the sheet, and those beyond a pole.
std::vector<char> CellTiles::closed_cells(const Samples& s, const std::vector<int>& touching,
                                          std::vector<SourceIndex>& unusable) const {
  std::vector<char> valid(static_cast<std::size_t>(s.side) * static_cast<std::size_t>(s.side));
  for (const int source : touching)
    if (groups_.sheet[static_cast<std::size_t>(source)] == s.sheet_index) add_valid(source, s, valid, unusable);
  std::vector<char> closed(s.places.size());
  for (int y = 0; y < s.side; ++y)
    for (int x = 0; x < s.side; ++x)
      if (valid[static_cast<std::size_t>(y * s.side + x)])
        closed[static_cast<std::size_t>(y / s.per_cell * kTileCells + x / s.per_cell)] = ValidPosts::kInside;
  for (std::size_t i = 0; i < s.places.size(); ++i)
    if (std::abs(s.places[i].lat_deg) > 90) closed[i] = ValidPosts::kInside;
  return closed;
}

// Which samples are valid posts of a file.
void CellTiles::add_valid(int source, const Samples& s, std::vector<char>& valid,
                          std::vector<SourceIndex>& unusable) const {
  std::vector<char> read;
  const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
  const auto [shift_x, shift_y] = groups_.shift[static_cast<std::size_t>(source)];
  const bool around = info.wraps_longitude;
  for (const std::int64_t turn : {-1, 0, 1}) {
    if (turn != 0 && (s.sheet.globe == 0 || around)) continue;
    // Samples whose posts lie in the file; all rows and columns of one that holds the globe go on beyond its ends.
    const std::int64_t first_x = s.x0 - shift_x + turn * s.sheet.globe, first_y = s.y0 - shift_y;
    const auto from = [&](std::int64_t first) { return std::max<std::int64_t>(0, -floor_div(first, s.stride)); };
    const auto to = [&](std::int64_t first, std::int64_t size) {
      return std::clamp<std::int64_t>(floor_div(size - 1 - first, s.stride) + 1, 0, s.side);
    };
    const std::int64_t x_from = around ? 0 : from(first_x), x_to = around ? s.side : to(first_x, info.width);
    const std::int64_t y_from = around ? 0 : from(first_y), y_to = around ? s.side : to(first_y, info.height);
    if (x_from >= x_to || y_from >= y_to) continue;
    const bool remote = is_remote(info.path);
    const auto w = static_cast<int>((x_to - x_from - 1) * s.stride + 1);
    const std::int64_t rows_at_once = s.stride == 1 ? kRowsRead : 1;
    for (std::int64_t y = y_from; y < y_to; y += rows_at_once) {
      const auto h = static_cast<int>(std::min(rows_at_once, y_to - y));
      if (!remote) posts_.read(source, first_x + x_from * s.stride, first_y + y * s.stride, w, h, read, unusable);
      for (int r = 0; r < h; ++r)
        for (std::int64_t x = x_from; x < x_to; ++x)
          valid[static_cast<std::size_t>((y + r) * s.side + x)] |=
              remote || read[static_cast<std::size_t>(r) * static_cast<std::size_t>(w) +
                             static_cast<std::size_t>((x - x_from) * s.stride)];
    }
  }
}

// Opens those cells that no file of the layer on another grid covers, either, and a coarser layer does.
void CellTiles::open_over(const Samples& s, const std::vector<int>& touching, std::vector<char> closed,
                          Tile& tile) const {
  using Reach = ValidPosts::Reach;
  for (const int source : touching)
    if (catalogue_.layer_begin(source) == s.sheet.layer_begin &&
        groups_.sheet[static_cast<std::size_t>(source)] != s.sheet_index)
      posts_.cover(source, s.places, Reach::half_a_post, closed, tile.unusable);
  std::vector<char> beneath = closed;  // who is closed need not be looked for
  int layer = -1;
  for (const int source : touching) {
    if (source >= s.sheet.layer_begin) break;
    if (std::exchange(layer, catalogue_.layer_begin(source)) != catalogue_.layer_begin(source))
      for (char& c : beneath) c = is_closed(c) ? ValidPosts::kInside : 0;
    posts_.cover(source, s.places, Reach::none, beneath, tile.unusable);
  }
  for (std::size_t i = 0; i < s.places.size(); ++i)
    if (!is_closed(closed[i]) && is_closed(beneath[i])) {
      tile.any = true;
      tile.rows[i / kTileCells] |= std::uint64_t{1} << (i % kTileCells);
    }
}

OpenCells CellTiles::within(int sheet, int octave, const CellRegion& region, std::vector<SourceIndex>& unusable) const {
  OpenCells cells{region};
  for (std::int64_t row = floor_div(region.y0, kTileCells); row <= floor_div(region.y1 - 1, kTileCells); ++row)
    for (std::int64_t column = floor_div(region.x0, kTileCells); column <= floor_div(region.x1 - 1, kTileCells);
         ++column) {
      const std::shared_ptr<const Tile> found = tile({sheet, octave, column, row});
      unusable.insert(unusable.end(), found->unusable.begin(), found->unusable.end());
      if (!found->any) continue;
      const std::int64_t left = column * kTileCells, top = row * kTileCells;
      for (std::int64_t y = std::max(region.y0, top); y < std::min(region.y1, top + kTileCells); ++y) {
        const std::uint64_t bits = found->rows[static_cast<std::size_t>(y - top)];
        if (bits == 0) continue;
        for (std::int64_t x = std::max(region.x0, left); x < std::min(region.x1, left + kTileCells); ++x) {
          if (!(bits >> (x - left) & 1)) continue;
          if (!cells.any) cells.open.resize(cells.region.columns() * cells.region.rows());
          cells.any = true;
          cells.open[cells.region.index(x, y)] = 1;
        }
      }
    }
  return cells;
}

}  // namespace selenograph::dem
