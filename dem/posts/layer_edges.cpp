#include "dem/posts/layer_edges.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "dem/gdal/remote_names.h"
#include "dem/support/error.h"

namespace selenograph::dem {
namespace {

constexpr int kTileCells = 64;
constexpr int kSamples = 4;              // of a cell, along each side
constexpr int kHoleCells = 4;            // over which a hole of one cell is blended
constexpr int kBandCells = 8;            // at least that many cells of the coarsest octave make the band
constexpr double kLeastScale = 1.0 / 8;  // of longitudes: beyond 83 degrees bands narrow towards the poles
constexpr std::size_t kMostTiles = std::size_t{1} << 18;  // some 150 MB
constexpr std::int64_t kMostBorderCells = std::int64_t{1} << 24;
constexpr double kLeastBorderPosts = 256;
constexpr double kBorder_deg = 1e-6;     // 3 cm: layers that have only their border in common lie beside each other
constexpr std::size_t kSmallGroup = 64;  // files whose outline is looked at in all
constexpr int kRowsRead = 64;

std::int64_t floor_div(std::int64_t a, std::int64_t b) { return a >= 0 ? a / b : -((b - 1 - a) / b); }

// 1 - smoothstep: 1 where a cell is beside an open one, 0 from `width` cells on.
float share_at(double distance, double width) {
  const double t = std::clamp((distance - 1) / width, 0.0, 1.0);
  return static_cast<float>((1 - t) * (1 - t) * (1 + 2 * t));
}

float joined(float a, float b) { return a + b - a * b; }

// Cells of one octave.
struct Region {
  std::int64_t x0, y0, x1, y1;
  std::size_t columns() const { return static_cast<std::size_t>(x1 - x0); }
  std::size_t rows() const { return static_cast<std::size_t>(y1 - y0); }
  std::size_t index(std::int64_t x, std::int64_t y) const {
    return static_cast<std::size_t>(y - y0) * columns() + static_cast<std::size_t>(x - x0);
  }
};

// The cells of the next octave that the subdivision of a region needs.
Region coarser(const Region& r) {
  return {floor_div(r.x0, 2) - 1, floor_div(r.y0, 2) - 1, floor_div(r.x1 - 1, 2) + 2, floor_div(r.y1 - 1, 2) + 2};
}

// Chaikin's corner cutting in both directions: each cell takes 9/16 of its parent, and 3/16, 3/16 and 1/16 of those
// beside it. All are exact, so that zeros stay zeros.
std::vector<float> refined(const std::vector<float>& coarse, const Region& from, const Region& to) {
  std::vector<float> fine(to.columns() * to.rows());
  for (std::int64_t y = to.y0; y < to.y1; ++y) {
    const std::int64_t py = floor_div(y, 2), qy = y - 2 * py == 0 ? py - 1 : py + 1;
    for (std::int64_t x = to.x0; x < to.x1; ++x) {
      const std::int64_t px = floor_div(x, 2), qx = x - 2 * px == 0 ? px - 1 : px + 1;
      fine[to.index(x, y)] = 0.5625F * coarse[from.index(px, py)] + 0.1875F * coarse[from.index(qx, py)] +
                             0.1875F * coarse[from.index(px, qy)] + 0.0625F * coarse[from.index(qx, qy)];
    }
  }
  return fine;
}

}  // namespace

// A grid that the posts of some files of a layer lie on; its post (0, 0) is the first of the first file.
struct LayerEdges::Sheet {
  const RasterInfo* reference = nullptr;
  int layer_begin = 0;
  std::int64_t globe = 0;  // posts around the globe, where they are a whole number; else 0
  std::vector<int> sources;

  bool polar() const { return std::holds_alternative<PolarGrid>(reference->grid); }
  // Not wrapped: latitudes beyond a pole are where nothing is.
  Geographic place(double x, double y) const {
    if (const auto* g = std::get_if<PolarGrid>(&reference->grid))
      return place_on(*g, g->first_x_m + x * g->spacing_m, g->first_y_m - y * g->spacing_m);
    const auto& g = std::get<GeographicGrid>(reference->grid);
    return {g.first_lat_deg - y / g.lat_posts_per_degree, g.first_lon_deg + x / g.lon_posts_per_degree, 0};
  }
  // Of a column's spacing by a row's, on the ground.
  double column_scale(double y) const {
    const auto* g = std::get_if<GeographicGrid>(&reference->grid);
    if (!g) return 1;
    const double lat = g->first_lat_deg - y / g->lat_posts_per_degree;
    return std::max(kLeastScale, std::cos(lat * kRadiansPerDegree) * g->lat_posts_per_degree / g->lon_posts_per_degree);
  }
  // Where a file's first post lies.
  std::optional<std::pair<std::int64_t, std::int64_t>> shift_of(const RasterInfo& info) const {
    constexpr double kTolerance = 1e-3;  // of a post
    double dx = 0, dy = 0;
    if (info.grid.index() != reference->grid.index()) return std::nullopt;
    if (const auto* a = std::get_if<PolarGrid>(&reference->grid)) {
      const auto& b = std::get<PolarGrid>(info.grid);
      if (a->north != b.north || a->scale != b.scale || std::abs(a->spacing_m / b.spacing_m - 1) > 1e-9 ||
          std::abs(std::remainder(a->central_lon_deg - b.central_lon_deg, 360)) > 1e-12)
        return std::nullopt;
      dx = (b.first_x_m - a->first_x_m) / a->spacing_m, dy = (a->first_y_m - b.first_y_m) / a->spacing_m;
    } else {
      const auto& a2 = std::get<GeographicGrid>(reference->grid);
      const auto& b = std::get<GeographicGrid>(info.grid);
      if (std::abs(a2.lat_posts_per_degree / b.lat_posts_per_degree - 1) > 1e-9 ||
          std::abs(a2.lon_posts_per_degree / b.lon_posts_per_degree - 1) > 1e-9)
        return std::nullopt;
      dx = (b.first_lon_deg - a2.first_lon_deg) * a2.lon_posts_per_degree;
      dy = (a2.first_lat_deg - b.first_lat_deg) * a2.lat_posts_per_degree;
    }
    if (std::abs(dx - std::round(dx)) > kTolerance || std::abs(dy - std::round(dy)) > kTolerance) return std::nullopt;
    return std::pair{std::llround(dx), std::llround(dy)};
  }
};

// Files of a sheet that touch each other.
struct LayerEdges::Group {
  int sheet = 0;
  std::vector<int> sources;
  std::int64_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // of the sheet's posts
  // Once settled:
  Once once;
  double spacing_ratio = 1;  // of the coarser layer's posts: the finest that it lies over
  double band_posts = 0;
  int octave = 0;    // of the band
  double cells = 1;  // its width
};

struct LayerEdges::Groups {
  std::vector<Sheet> sheets;
  std::vector<std::unique_ptr<Group>> groups;
  // By source; -1: of the coarsest layer.
  std::vector<int> sheet, group;
  std::vector<std::pair<std::int64_t, std::int64_t>> shift;
};

// Open cells, a bit each.
struct LayerEdges::Tile {
  bool any = false;
  std::array<std::uint64_t, kTileCells> rows{};
  std::vector<SourceIndex> unusable{};
};

struct LayerEdges::Cells {
  Region region;
  bool any = false;
  std::vector<char> open{};
};

double widest_post_deg(const RasterInfo& info) {
  const auto* grid = std::get_if<GeographicGrid>(&info.grid);
  return 1 / (grid ? std::min(grid->lat_posts_per_degree, grid->lon_posts_per_degree) : info.posts_per_degree);
}

LayerEdges::LayerEdges(const Catalogue& catalogue, Read read, bool fall_through)
    : catalogue_(catalogue), read_(std::move(read)), fall_through_(fall_through), meets_(catalogue.rasters().size()) {
  for (auto& m : meets_) m = -1;
}

LayerEdges::~LayerEdges() = default;

bool LayerEdges::meets(int source) const {
  const int begin = catalogue_.layer_begin(source);
  if (begin == 0 || !(catalogue_.joins().blend_posts >= 0)) return false;
  std::atomic<signed char>& known = meets_[static_cast<std::size_t>(source)];
  if (known < 0) {
    const Footprint& f = catalogue_.rasters()[static_cast<std::size_t>(source)].footprint;
    const std::vector<int> there = catalogue_.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, -kBorder_deg);
    known = !there.empty() && there.front() < begin;
  }
  return known > 0;
}

const LayerEdges::Groups& LayerEdges::groups() const {
  grouped_.run([&] {
    auto found = std::make_unique<Groups>();
    const std::vector<RasterInfo>& rasters = catalogue_.rasters();
    const std::size_t n = rasters.size();
    found->sheet.assign(n, -1), found->group.assign(n, -1), found->shift.resize(n);
    for (std::size_t i = 0; i < n; ++i) {
      const int begin = catalogue_.layer_begin(static_cast<int>(i));
      if (begin == 0) continue;
      std::optional<std::pair<std::int64_t, std::int64_t>> shift;
      std::size_t s = found->sheets.size();
      while (s > 0 && found->sheets[s - 1].layer_begin == begin && !(shift = found->sheets[s - 1].shift_of(rasters[i])))
        --s;
      if (!shift) {
        Sheet sheet{&rasters[i], begin, 0, {}};
        if (const auto* g = std::get_if<GeographicGrid>(&rasters[i].grid)) {
          const double around = 360 * g->lon_posts_per_degree;
          if (std::abs(around - std::round(around)) < 1e-6) sheet.globe = std::llround(around);
        }
        found->sheets.push_back(std::move(sheet));
        s = found->sheets.size();
        shift = {0, 0};
      }
      found->sheets[s - 1].sources.push_back(static_cast<int>(i));
      found->sheet[i] = static_cast<int>(s) - 1, found->shift[i] = *shift;
    }
    // Those that touch, by the smallest of their numbers.
    std::vector<int> root(n);
    std::iota(root.begin(), root.end(), 0);
    const auto root_of = [&](int i) {
      while (root[static_cast<std::size_t>(i)] != i)
        i = root[static_cast<std::size_t>(i)] = root[static_cast<std::size_t>(root[static_cast<std::size_t>(i)])];
      return i;
    };
    for (std::size_t i = 0; i < n; ++i) {
      if (found->sheet[i] < 0) continue;
      const Footprint& f = rasters[i].footprint;
      for (const int other :
           catalogue_.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, 2 * widest_post_deg(rasters[i]))) {
        if (found->sheet[static_cast<std::size_t>(other)] != found->sheet[i]) continue;
        const int a = root_of(static_cast<int>(i)), b = root_of(other);
        root[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
      }
    }
    for (std::size_t i = 0; i < n; ++i) {
      if (found->sheet[i] < 0) continue;
      const auto first = static_cast<std::size_t>(root_of(static_cast<int>(i)));
      const auto [x, y] = found->shift[i];
      const RasterInfo& info = rasters[i];
      if (first == i) {
        found->group[i] = static_cast<int>(found->groups.size());
        auto group = std::make_unique<Group>();
        group->sheet = found->sheet[i];
        group->x0 = x, group->y0 = y, group->x1 = x + info.width, group->y1 = y + info.height;
        found->groups.push_back(std::move(group));
      }
      found->group[i] = found->group[first];
      Group& group = *found->groups[static_cast<std::size_t>(found->group[i])];
      group.sources.push_back(static_cast<int>(i));
      group.x0 = std::min(group.x0, x), group.x1 = std::max(group.x1, x + info.width);
      group.y0 = std::min(group.y0, y), group.y1 = std::max(group.y1, y + info.height);
    }
    groups_ = std::move(found);
  });
  return *groups_;
}

const LayerEdges::Group& LayerEdges::settled(int source) const {
  const Groups& all = groups();
  Group& group = *all.groups[static_cast<std::size_t>(all.group[static_cast<std::size_t>(source)])];
  group.once.run([&] { settle(group); });
  return group;
}

void LayerEdges::settle(Group& group) const {
  const Sheet& sheet = groups().sheets[static_cast<std::size_t>(group.sheet)];
  int beneath = -1;
  for (const int i : group.sources) {
    const Footprint& f = catalogue_.rasters()[static_cast<std::size_t>(i)].footprint;
    const std::vector<int> there = catalogue_.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, -kBorder_deg);
    const auto past = std::lower_bound(there.begin(), there.end(), sheet.layer_begin);
    if (past != there.begin()) beneath = std::max(beneath, *std::prev(past));
  }
  if (beneath < 0) return;
  group.spacing_ratio =
      catalogue_.rasters()[static_cast<std::size_t>(beneath)].post_spacing_m / sheet.reference->post_spacing_m;
  double band = catalogue_.joins().blend_posts * group.spacing_ratio;
  if (!(band > 0)) return;
  const auto octave_of = [&](double posts) {
    int octave = std::max(0, static_cast<int>(std::floor(std::log2(std::max(posts / kBandCells, 1.0)))));
    while (sheet.globe % (std::int64_t{1} << octave) != 0) --octave;  // the same cells from either side of the globe
    return octave;
  };
  const auto side = static_cast<double>(std::min(group.x1 - group.x0, group.y1 - group.y0));
  if (group.sources.size() <= kSmallGroup && side < 8 * band) {
    try {
      band = std::min(band, half_width_posts(group, octave_of(std::min(band, side / 2))) / 2);
    } catch (const DataError&) {
      // Who needs the posts of the file that can't be read will say so.
      band = std::min(band, side / 4);
    }
  }
  group.octave = octave_of(band);
  // Less by what the distance between cells' middles, cells that are open in part and the spline reach further.
  group.cells = std::max(1.0, band / std::ldexp(1.0, group.octave) - 3);
  group.band_posts = band;
}

// The largest distance of a post of the group from the layer beneath; infinite, where that is nowhere seen.
double LayerEdges::half_width_posts(const Group& group, int octave) const {
  const Sheet& sheet = groups().sheets[static_cast<std::size_t>(group.sheet)];
  const std::int64_t size = std::int64_t{1} << octave;
  std::vector<SourceIndex> unusable;
  const Region r{floor_div(group.x0, size) - 1, floor_div(group.y0, size) - 1, floor_div(group.x1 - 1, size) + 2,
                 floor_div(group.y1 - 1, size) + 2};
  const Cells cells = open_cells(group.sheet, octave, r.x0, r.y0, r.x1, r.y1, unusable);
  if (!cells.any) return std::numeric_limits<double>::infinity();
  // Along columns, then along rows: exact (Felzenszwalb & Huttenlocher 2012, by search instead of envelopes).
  const auto far = static_cast<double>(r.rows() + r.columns());
  std::vector<double> along(cells.open.size(), far);
  for (std::int64_t x = r.x0; x < r.x1; ++x) {
    double since = far;
    for (std::int64_t y = r.y0; y < r.y1; ++y) along[r.index(x, y)] = since = cells.open[r.index(x, y)] ? 0 : since + 1;
    since = far;
    for (std::int64_t y = r.y1; y-- > r.y0;) {
      since = cells.open[r.index(x, y)] ? 0 : since + 1;
      along[r.index(x, y)] = std::min(along[r.index(x, y)], since);
    }
  }
  double widest = 0;
  for (std::int64_t y = r.y0; y < r.y1; ++y) {
    const double scale = sheet.column_scale((static_cast<double>(y) + 0.5) * static_cast<double>(size));
    for (std::int64_t x = r.x0; x < r.x1; ++x) {
      double best = std::min(far, along[r.index(x, y)]);
      best *= best;
      for (std::int64_t k = 1;; ++k) {
        const double dx = scale * static_cast<double>(k), dx2 = dx * dx;
        if (dx2 >= best || (x - k < r.x0 && x + k >= r.x1)) break;
        for (const std::int64_t other : {x - k, x + k})
          if (other >= r.x0 && other < r.x1) {
            const double dy = along[r.index(other, y)];
            best = std::min(best, dx2 + dy * dy);
          }
      }
      widest = std::max(widest, best);
    }
  }
  return std::sqrt(widest) * static_cast<double>(size);
}

double LayerEdges::band_posts(int source) const { return meets(source) ? settled(source).band_posts : 0; }

const std::vector<int>& LayerEdges::group_of(int source) const {
  const Groups& all = groups();
  return all.groups[static_cast<std::size_t>(all.group[static_cast<std::size_t>(source)])]->sources;
}

// A piece of a file that is w x h posts. False: the file can't be read.
void LayerEdges::read_valid(int source, std::int64_t x0, std::int64_t y0, int w, int h, std::vector<char>& valid,
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

// Adds to the cover of places: kInside where the nearest post is a valid one of the file, kBeside less than a post
// outside of a valid outermost one. Tiles of one product leave a gap of a post between them: what is beside two of them
// lies between.
void LayerEdges::cover(int source, const std::vector<Geographic>& places, Reach reach, std::vector<char>& cover,
                       std::vector<SourceIndex>& unusable) const {
  const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
  struct At {
    std::size_t place;
    int x, y;
    char cover;
  };
  std::vector<At> near;
  int x0 = info.width, y0 = info.height, x1 = 0, y1 = 0;
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
    near.push_back({i, std::clamp(x, 0, info.width - 1),
                    std::clamp(static_cast<int>(std::round(p.y)), 0, info.height - 1), inside ? kInside : kBeside});
    x0 = std::min(x0, near.back().x), x1 = std::max(x1, near.back().x);
    y0 = std::min(y0, near.back().y), y1 = std::max(y1, near.back().y);
  }
  if (near.empty()) return;
  const auto add = [&](const At& at, bool valid) {
    if (valid) cover[at.place] = static_cast<char>(cover[at.place] + at.cover);
  };
  constexpr std::int64_t kMostAtOnce = 1 << 20;
  std::vector<char> valid;
  const int w = x1 - x0 + 1, h = y1 - y0 + 1;
  if (is_remote(info.path)) {
    for (const At& at : near) add(at, true);
  } else if (std::int64_t{w} * h <= kMostAtOnce) {
    read_valid(source, x0, y0, w, h, valid, unusable);
    for (const At& at : near)
      add(at, valid[static_cast<std::size_t>(at.y - y0) * static_cast<std::size_t>(w) +
                    static_cast<std::size_t>(at.x - x0)]);
  } else {
    for (const At& at : near) {
      read_valid(source, at.x, at.y, 1, 1, valid, unusable);
      add(at, valid[0]);
    }
  }
}

std::shared_ptr<const LayerEdges::Tile> LayerEdges::tile(const TileKey& key) const {
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
std::shared_ptr<const LayerEdges::Tile> LayerEdges::joined_tile(const TileKey& key) const {
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

std::shared_ptr<const LayerEdges::Tile> LayerEdges::make_tile(const TileKey& key) const {
  const auto [sheet_index, octave, column, row] = key;
  if (octave > 0 && (std::int64_t{1} << octave) <= kSamples) return joined_tile(key);
  const Sheet& sheet = groups().sheets[static_cast<std::size_t>(sheet_index)];
  const std::int64_t cell = std::int64_t{1} << octave, span = kTileCells * cell;
  const std::int64_t tile_x0 = column * span, tile_y0 = row * span;
  const int per_cell = static_cast<int>(std::min<std::int64_t>(cell, kSamples));
  const int side = kTileCells * per_cell;
  const std::int64_t stride = cell / per_cell;
  auto made = std::make_shared<Tile>();

  // The tile's place, with a margin for posts that lie between those of other grids.
  std::vector<Geographic> places;
  double south = 90, north = -90, west = 360, east = -360;
  for (int y = 0; y < kTileCells; ++y)
    for (int x = 0; x < kTileCells; ++x) {
      const double middle = static_cast<double>(cell - 1) / 2;
      places.push_back(sheet.place(static_cast<double>(tile_x0 + x * cell) + middle,
                                   static_cast<double>(tile_y0 + y * cell) + middle));
      south = std::min(south, places.back().lat_deg), north = std::max(north, places.back().lat_deg);
      west = std::min(west, places.back().lon_deg), east = std::max(east, places.back().lon_deg);
    }
  if (sheet.polar()) west = -180, east = 180;
  south = std::max(south, -90.0), north = std::min(north, 90.0);
  if (south > north) return made;  // beyond a pole
  const double margin = 2 * static_cast<double>(cell) * widest_post_deg(*sheet.reference);
  const std::vector<int> touching = catalogue_.touching(south, north, west, east, margin);

  // Which samples are valid posts of the sheet.
  std::vector<char> valid(static_cast<std::size_t>(side) * static_cast<std::size_t>(side));
  const Groups& all = groups();
  std::vector<char> read;
  for (const int source : touching) {
    if (all.sheet[static_cast<std::size_t>(source)] != sheet_index) continue;
    const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(source)];
    const auto [shift_x, shift_y] = all.shift[static_cast<std::size_t>(source)];
    const bool around = info.wraps_longitude;
    for (const std::int64_t turn : {-1, 0, 1}) {
      if (turn != 0 && (sheet.globe == 0 || around)) continue;
      // Samples whose posts lie in the file; all rows and columns of one that holds the globe go on beyond its ends.
      const std::int64_t first_x = tile_x0 - shift_x + turn * sheet.globe, first_y = tile_y0 - shift_y;
      const auto from = [&](std::int64_t first) { return std::max<std::int64_t>(0, -floor_div(first, stride)); };
      const auto to = [&](std::int64_t first, std::int64_t size) {
        return std::clamp<std::int64_t>(floor_div(size - 1 - first, stride) + 1, 0, side);
      };
      const std::int64_t x_from = around ? 0 : from(first_x), x_to = around ? side : to(first_x, info.width);
      const std::int64_t y_from = around ? 0 : from(first_y), y_to = around ? side : to(first_y, info.height);
      if (x_from >= x_to || y_from >= y_to) continue;
      const bool remote = is_remote(info.path);
      const auto w = static_cast<int>((x_to - x_from - 1) * stride + 1);
      const std::int64_t rows_at_once = stride == 1 ? kRowsRead : 1;
      for (std::int64_t y = y_from; y < y_to; y += rows_at_once) {
        const auto h = static_cast<int>(std::min(rows_at_once, y_to - y));
        if (!remote) read_valid(source, first_x + x_from * stride, first_y + y * stride, w, h, read, made->unusable);
        for (int r = 0; r < h; ++r)
          for (std::int64_t x = x_from; x < x_to; ++x)
            valid[static_cast<std::size_t>((y + r) * side + x)] |=
                remote || read[static_cast<std::size_t>(r) * static_cast<std::size_t>(w) +
                               static_cast<std::size_t>((x - x_from) * stride)];
      }
    }
  }

  std::vector<char> closed(places.size());
  for (int y = 0; y < side; ++y)
    for (int x = 0; x < side; ++x)
      if (valid[static_cast<std::size_t>(y * side + x)])
        closed[static_cast<std::size_t>(y / per_cell * kTileCells + x / per_cell)] = kInside;
  for (std::size_t i = 0; i < places.size(); ++i)
    if (std::abs(places[i].lat_deg) > 90) closed[i] = kInside;
  const auto is_closed = [](char c) { return c >= kInside; };
  if (std::all_of(closed.begin(), closed.end(), is_closed)) return made;
  // Files of the same resolution on other grids.
  for (const int source : touching)
    if (catalogue_.layer_begin(source) == sheet.layer_begin &&
        all.sheet[static_cast<std::size_t>(source)] != sheet_index)
      cover(source, places, Reach::half_a_post, closed, made->unusable);
  std::vector<char> beneath = closed;  // who is closed need not be looked for
  int layer = -1;
  for (const int source : touching) {
    if (source >= sheet.layer_begin) break;
    if (std::exchange(layer, catalogue_.layer_begin(source)) != catalogue_.layer_begin(source))
      for (char& c : beneath) c = is_closed(c) ? kInside : 0;
    cover(source, places, Reach::none, beneath, made->unusable);
  }
  for (std::size_t i = 0; i < places.size(); ++i)
    if (!is_closed(closed[i]) && is_closed(beneath[i])) {
      made->any = true;
      made->rows[i / kTileCells] |= std::uint64_t{1} << (i % kTileCells);
    }
  return made;
}

LayerEdges::Cells LayerEdges::open_cells(int sheet, int octave, std::int64_t x0, std::int64_t y0, std::int64_t x1,
                                         std::int64_t y1, std::vector<SourceIndex>& unusable) const {
  Cells cells{{x0, y0, x1, y1}};
  for (std::int64_t row = floor_div(y0, kTileCells); row <= floor_div(y1 - 1, kTileCells); ++row)
    for (std::int64_t column = floor_div(x0, kTileCells); column <= floor_div(x1 - 1, kTileCells); ++column) {
      const std::shared_ptr<const Tile> found = tile({sheet, octave, column, row});
      unusable.insert(unusable.end(), found->unusable.begin(), found->unusable.end());
      if (!found->any) continue;
      const std::int64_t left = column * kTileCells, top = row * kTileCells;
      for (std::int64_t y = std::max(y0, top); y < std::min(y1, top + kTileCells); ++y) {
        const std::uint64_t bits = found->rows[static_cast<std::size_t>(y - top)];
        if (bits == 0) continue;
        for (std::int64_t x = std::max(x0, left); x < std::min(x1, left + kTileCells); ++x) {
          if (!(bits >> (x - left) & 1)) continue;
          if (!cells.any) cells.open.resize(cells.region.columns() * cells.region.rows());
          cells.any = true;
          cells.open[cells.region.index(x, y)] = 1;
        }
      }
    }
  return cells;
}

std::optional<LayerEdges::Shares> LayerEdges::shares(int source, int x0, int y0, int w, int h,
                                                     std::vector<SourceIndex>& unusable) const {
  return shares_of(source, x0, y0, w, h, Octaves::all, unusable);
}

std::optional<LayerEdges::Shares> LayerEdges::shares_of_outline(int source, int x0, int y0, int w, int h) const {
  std::vector<SourceIndex> unusable;  // are told of where heights are
  return shares_of(source, x0, y0, w, h, Octaves::coarsest, unusable);
}

std::optional<LayerEdges::Shares> LayerEdges::shares_of(int source, int x0, int y0, int w, int h, Octaves octaves,
                                                        std::vector<SourceIndex>& unusable) const {
  if (!meets(source)) return std::nullopt;
  const Group& group = settled(source);
  if (!(group.band_posts > 0)) return std::nullopt;
  const Sheet& sheet = groups().sheets[static_cast<std::size_t>(group.sheet)];
  const auto [shift_x, shift_y] = groups().shift[static_cast<std::size_t>(source)];
  const int finest = octaves == Octaves::all ? 0 : group.octave;
  const std::int64_t finest_cell = std::int64_t{1} << finest;
  std::vector<Region> regions(static_cast<std::size_t>(group.octave) + 1);
  regions[static_cast<std::size_t>(finest)] = {
      floor_div(shift_x + x0, finest_cell) - 1, floor_div(shift_y + y0, finest_cell) - 1,
      floor_div(shift_x + x0 + w - 1, finest_cell) + 2, floor_div(shift_y + y0 + h - 1, finest_cell) + 2};
  for (auto j = static_cast<std::size_t>(finest); j + 1 < regions.size(); ++j) regions[j + 1] = coarser(regions[j]);

  std::vector<float> points;  // empty: 0
  for (int j = group.octave; j >= finest; --j) {
    const Region& r = regions[static_cast<std::size_t>(j)];
    if (!points.empty()) points = refined(points, regions[static_cast<std::size_t>(j) + 1], r);
    const double width = j == group.octave ? group.cells : kHoleCells;
    const auto cell = static_cast<double>(std::int64_t{1} << j);
    std::vector<double> scales;  // of rows
    for (std::int64_t y = r.y0; y < r.y1; ++y)
      scales.push_back(sheet.column_scale((static_cast<double>(y) + 0.5) * cell));
    const auto reach_y = static_cast<std::int64_t>(std::ceil(width)) + 1;
    const auto reach_x =
        static_cast<std::int64_t>(std::ceil((width + 1) / *std::min_element(scales.begin(), scales.end())));
    const Cells cells =
        open_cells(group.sheet, j, r.x0 - reach_x, r.y0 - reach_y, r.x1 + reach_x, r.y1 + reach_y, unusable);
    if (!cells.any) continue;
    if (points.empty()) points.resize(r.columns() * r.rows());
    // The distance to the nearest open cell: along columns, then along rows.
    const Region& all = cells.region;
    std::vector<std::int64_t> along(all.columns() * r.rows());
    std::vector<std::int64_t> since(all.columns(), reach_y + 1);
    for (std::int64_t y = all.y0; y < r.y1; ++y)
      for (std::int64_t x = all.x0; x < all.x1; ++x) {
        std::int64_t& s = since[static_cast<std::size_t>(x - all.x0)];
        s = cells.open[all.index(x, y)] ? 0 : s + 1;
        if (y >= r.y0)
          along[static_cast<std::size_t>(y - r.y0) * all.columns() + static_cast<std::size_t>(x - all.x0)] = s;
      }
    std::fill(since.begin(), since.end(), reach_y + 1);
    for (std::int64_t y = all.y1; y-- > r.y0;)
      for (std::int64_t x = all.x0; x < all.x1; ++x) {
        std::int64_t& s = since[static_cast<std::size_t>(x - all.x0)];
        s = cells.open[all.index(x, y)] ? 0 : s + 1;
        if (y >= r.y1) continue;
        std::int64_t& d =
            along[static_cast<std::size_t>(y - r.y0) * all.columns() + static_cast<std::size_t>(x - all.x0)];
        d = std::min(d, s);
      }
    for (std::int64_t y = r.y0; y < r.y1; ++y) {
      const double scale = scales[static_cast<std::size_t>(y - r.y0)];
      const std::int64_t* row = along.data() + static_cast<std::size_t>(y - r.y0) * all.columns() - all.x0;
      if (std::all_of(row + all.x0, row + all.x1, [&](std::int64_t d) { return d > reach_y; })) continue;
      for (std::int64_t x = r.x0; x < r.x1; ++x) {
        double best = (width + 1) * (width + 1);
        for (std::int64_t k = 0; k <= reach_x; ++k) {
          const double dx = scale * static_cast<double>(k), dx2 = dx * dx;
          if (dx2 >= best) break;
          const auto dy = static_cast<double>(std::min(row[x - k], row[x + k]));
          best = std::min(best, dx2 + dy * dy);
        }
        float& point = points[r.index(x, y)];
        point = joined(point, share_at(std::sqrt(best), width));
      }
    }
  }
  if (std::all_of(points.begin(), points.end(), [](float e) { return e == 0; })) return std::nullopt;
  Shares found;
  const Region& r = regions[static_cast<std::size_t>(finest)];
  found.x0_ = r.x0, found.y0_ = r.y0, found.columns_ = r.x1 - r.x0;
  found.octave_ = finest;
  if (finest == 0)
    found.x0_ -= shift_x, found.y0_ -= shift_y;
  else
    found.shift_x_ = shift_x, found.shift_y_ = shift_y;
  found.points_ = std::move(points);
  return found;
}

double LayerEdges::Shares::at(double x, double y) const {
  if (octave_ != 0) {  // cells' middles
    const double cell = std::ldexp(1.0, octave_);
    x = (x + static_cast<double>(shift_x_) + 0.5) / cell - 0.5;
    y = (y + static_cast<double>(shift_y_) + 0.5) / cell - 0.5;
  }
  const double px = std::round(x), py = std::round(y);
  const auto weights = [](double u) {
    return std::array{(0.5 - u) * (0.5 - u) / 2, 0.75 - u * u, (0.5 + u) * (0.5 + u) / 2};
  };
  const std::array<double, 3> wx = weights(x - px), wy = weights(y - py);
  const auto rows = static_cast<std::int64_t>(points_.size()) / columns_;
  const std::int64_t c = static_cast<std::int64_t>(px) - x0_ - 1, r = static_cast<std::int64_t>(py) - y0_ - 1;
  if (c < 0 || r < 0 || c + 2 >= columns_ || r + 2 >= rows) return 0;  // not asked for
  double sum = 0;
  for (int j = 0; j < 3; ++j) {
    const float* row = points_.data() + (r + j) * columns_ + c;
    sum +=
        wy[static_cast<std::size_t>(j)] * (wx[0] * static_cast<double>(row[0]) + wx[1] * static_cast<double>(row[1]) +
                                           wx[2] * static_cast<double>(row[2]));
  }
  return sum;
}

std::vector<LayerEdges::BorderPost> LayerEdges::border(int source, std::size_t most) const {
  if (!meets(source)) return {};
  const Group& group = settled(source);
  const Groups& all = groups();
  const Sheet& sheet = all.sheets[static_cast<std::size_t>(group.sheet)];
  const auto around = static_cast<double>(2 * (group.x1 - group.x0 + group.y1 - group.y0));
  const double apart = std::min(group.spacing_ratio / 2, around / kLeastBorderPosts);
  int octave = std::max(0, static_cast<int>(std::floor(std::log2(std::max(apart, 1.0)))));
  while (sheet.globe % (std::int64_t{1} << octave) != 0) --octave;
  const std::int64_t cell = std::int64_t{1} << octave;
  const Region r{floor_div(group.x0, cell) - 1, floor_div(group.y0, cell) - 1, floor_div(group.x1 - 1, cell) + 2,
                 floor_div(group.y1 - 1, cell) + 2};
  if ((r.x1 - r.x0) * (r.y1 - r.y0) > kMostBorderCells) return {};
  std::vector<SourceIndex> unusable;
  const Cells cells = open_cells(group.sheet, octave, r.x0, r.y0, r.x1, r.y1, unusable);
  if (!cells.any) return {};
  struct Beside {
    std::int64_t x, y, dx, dy;
  };
  std::vector<Beside> found;
  for (std::int64_t y = r.y0 + 1; y < r.y1 - 1; ++y)
    for (std::int64_t x = r.x0 + 1; x < r.x1 - 1; ++x) {
      if (cells.open[r.index(x, y)]) continue;
      for (const auto& [dx, dy] : {std::pair{-1, 0}, {1, 0}, {0, -1}, {0, 1}})
        if (cells.open[r.index(x + dx, y + dy)]) {
          found.push_back({x, y, dx, dy});
          break;
        }
    }
  std::vector<BorderPost> posts;
  const std::size_t step = std::max<std::size_t>(1, (found.size() + most - 1) / std::max<std::size_t>(most, 1));
  std::vector<char> valid;
  for (std::size_t i = 0; i < found.size(); i += step) {
    const Beside& b = found[i];
    // The valid post nearest to the open cell's middle.
    const double tx = (static_cast<double>(b.x + b.dx) + 0.5) * static_cast<double>(cell) - 0.5,
                 ty = (static_cast<double>(b.y + b.dy) + 0.5) * static_cast<double>(cell) - 0.5;
    double nearest = std::numeric_limits<double>::infinity();
    BorderPost post{-1, 0, 0};
    for (const int s : group.sources) {
      const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(s)];
      const auto [sx, sy] = all.shift[static_cast<std::size_t>(s)];
      const std::int64_t x0 = std::max<std::int64_t>(b.x * cell - sx, 0),
                         y0 = std::max<std::int64_t>(b.y * cell - sy, 0),
                         x1 = std::min<std::int64_t>((b.x + 1) * cell - sx, info.width),
                         y1 = std::min<std::int64_t>((b.y + 1) * cell - sy, info.height);
      if (x0 >= x1 || y0 >= y1) continue;
      const auto w = static_cast<int>(x1 - x0), h = static_cast<int>(y1 - y0);
      read_valid(s, x0, y0, w, h, valid, unusable);
      for (int y = 0; y < h; ++y)
        for (int x = 0; x < w; ++x) {
          if (!valid[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)]) continue;
          const double distance =
              std::hypot(static_cast<double>(x0 + x + sx) - tx, static_cast<double>(y0 + y + sy) - ty);
          if (distance < nearest) nearest = distance, post = {s, static_cast<int>(x0) + x, static_cast<int>(y0) + y};
        }
    }
    if (post.source >= 0) posts.push_back(post);
  }
  return posts;
}

}  // namespace selenograph::dem
