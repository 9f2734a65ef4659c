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

constexpr int kHoleCells = 4;  // over which a hole of one cell is blended
constexpr int kBandCells = 8;  // at least that many cells of the coarsest octave make the band
constexpr std::int64_t kMostBorderCells = std::int64_t{1} << 24;
constexpr double kLeastBorderPosts = 256;
constexpr double kBorder_deg = 1e-6;     // 3 cm: layers that have only their border in common lie beside each other
constexpr std::size_t kSmallGroup = 64;  // files whose outline is looked at in all

// 1 - smoothstep: 1 where a cell is beside an open one, 0 from `width` cells on.
float share_at(double distance, double width) {
  const double t = std::clamp((distance - 1) / width, 0.0, 1.0);
  return static_cast<float>((1 - t) * (1 - t) * (1 + 2 * t));
}

float joined(float a, float b) { return a + b - a * b; }

// The cells of the next octave that the subdivision of a region needs.
CellRegion coarser(const CellRegion& r) {
  return {floor_div(r.x0, 2) - 1, floor_div(r.y0, 2) - 1, floor_div(r.x1 - 1, 2) + 2, floor_div(r.y1 - 1, 2) + 2};
}

// Chaikin's corner cutting in both directions: each cell takes 9/16 of its parent, and 3/16, 3/16 and 1/16 of those
// beside it. All are exact, so that zeros stay zeros.
std::vector<float> refined(const std::vector<float>& coarse, const CellRegion& from, const CellRegion& to) {
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

// Of each cell of a region how far the nearest open one is along its column; `reach` and more: farther than that. Row
// by row, with all columns of the open cells.
std::vector<std::int64_t> distances_along_columns(const OpenCells& cells, const CellRegion& r, std::int64_t reach) {
  const CellRegion& all = cells.region;
  std::vector<std::int64_t> along(all.columns() * r.rows());
  std::vector<std::int64_t> since(all.columns(), reach + 1);
  for (std::int64_t y = all.y0; y < r.y1; ++y)
    for (std::int64_t x = all.x0; x < all.x1; ++x) {
      std::int64_t& s = since[static_cast<std::size_t>(x - all.x0)];
      s = cells.open[all.index(x, y)] ? 0 : s + 1;
      if (y >= r.y0)
        along[static_cast<std::size_t>(y - r.y0) * all.columns() + static_cast<std::size_t>(x - all.x0)] = s;
    }
  std::fill(since.begin(), since.end(), reach + 1);
  for (std::int64_t y = all.y1; y-- > r.y0;)
    for (std::int64_t x = all.x0; x < all.x1; ++x) {
      std::int64_t& s = since[static_cast<std::size_t>(x - all.x0)];
      s = cells.open[all.index(x, y)] ? 0 : s + 1;
      if (y >= r.y1) continue;
      std::int64_t& d =
          along[static_cast<std::size_t>(y - r.y0) * all.columns() + static_cast<std::size_t>(x - all.x0)];
      d = std::min(d, s);
    }
  return along;
}

// How far a region's cells, of an octave, are looked from for open ones.
struct CellReach {
  double width;                // in cells, over which shares fall
  std::vector<double> scales;  // of rows: a column's width by a row's
  std::int64_t x = 0, y = 0;

  CellReach(const LayerSheet& sheet, const CellRegion& r, double cell, double share_width) : width(share_width) {
    for (std::int64_t row = r.y0; row < r.y1; ++row)
      scales.push_back(sheet.column_scale((static_cast<double>(row) + 0.5) * cell));
    y = static_cast<std::int64_t>(std::ceil(width)) + 1;
    x = static_cast<std::int64_t>(std::ceil((width + 1) / *std::min_element(scales.begin(), scales.end())));
  }
  CellRegion around(const CellRegion& r) const { return {r.x0 - x, r.y0 - y, r.x1 + x, r.y1 + y}; }
};

// Joins the shares that open cells have in the points of a region.
void join_shares(const OpenCells& cells, const CellRegion& r, const CellReach& reach, std::vector<float>& points) {
  const CellRegion& all = cells.region;
  const std::vector<std::int64_t> along = distances_along_columns(cells, r, reach.y);
  for (std::int64_t y = r.y0; y < r.y1; ++y) {
    const double scale = reach.scales[static_cast<std::size_t>(y - r.y0)];
    const std::int64_t* row = along.data() + static_cast<std::size_t>(y - r.y0) * all.columns() - all.x0;
    if (std::all_of(row + all.x0, row + all.x1, [&](std::int64_t d) { return d > reach.y; })) continue;
    for (std::int64_t x = r.x0; x < r.x1; ++x) {
      double best = (reach.width + 1) * (reach.width + 1);
      for (std::int64_t k = 0; k <= reach.x; ++k) {
        const double dx = scale * static_cast<double>(k), dx2 = dx * dx;
        if (dx2 >= best) break;
        const auto dy = static_cast<double>(std::min(row[x - k], row[x + k]));
        best = std::min(best, dx2 + dy * dy);
      }
      float& point = points[r.index(x, y)];
      point = joined(point, share_at(std::sqrt(best), reach.width));
    }
  }
}

}  // namespace

LayerEdges::LayerEdges(const Catalogue& catalogue, ValidPosts::Read read, bool fall_through)
    : catalogue_(catalogue), posts_(catalogue, std::move(read), fall_through), meets_(catalogue.rasters().size()) {
  for (auto& m : meets_) m = -1;
}

LayerEdges::~LayerEdges() = default;

const LayerEdges::Found& LayerEdges::found() const {
  grouped_.run([&] { found_ = std::make_unique<Found>(catalogue_, posts_); });
  return *found_;
}

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

const LayerGroup& LayerEdges::settled(int source) const {
  const LayerGroups& all = groups();
  LayerGroup& group = *all.groups[static_cast<std::size_t>(all.group[static_cast<std::size_t>(source)])];
  group.once.run([&] { settle(group); });
  return group;
}

void LayerEdges::settle(LayerGroup& group) const {
  const LayerSheet& sheet = groups().sheets[static_cast<std::size_t>(group.sheet)];
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
double LayerEdges::half_width_posts(const LayerGroup& group, int octave) const {
  const LayerSheet& sheet = groups().sheets[static_cast<std::size_t>(group.sheet)];
  const std::int64_t size = std::int64_t{1} << octave;
  std::vector<SourceIndex> unusable;
  const CellRegion r{floor_div(group.x0, size) - 1, floor_div(group.y0, size) - 1, floor_div(group.x1 - 1, size) + 2,
                     floor_div(group.y1 - 1, size) + 2};
  const OpenCells cells = this->cells().within(group.sheet, octave, r, unusable);
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
  const LayerGroups& all = groups();
  return all.groups[static_cast<std::size_t>(all.group[static_cast<std::size_t>(source)])]->sources;
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
  const LayerGroup& group = settled(source);
  if (!(group.band_posts > 0)) return std::nullopt;
  const LayerSheet& sheet = groups().sheets[static_cast<std::size_t>(group.sheet)];
  const auto [shift_x, shift_y] = groups().shift[static_cast<std::size_t>(source)];
  const int finest = octaves == Octaves::all ? 0 : group.octave;
  const std::int64_t finest_cell = std::int64_t{1} << finest;
  std::vector<CellRegion> regions(static_cast<std::size_t>(group.octave) + 1);
  regions[static_cast<std::size_t>(finest)] = {
      floor_div(shift_x + x0, finest_cell) - 1, floor_div(shift_y + y0, finest_cell) - 1,
      floor_div(shift_x + x0 + w - 1, finest_cell) + 2, floor_div(shift_y + y0 + h - 1, finest_cell) + 2};
  for (auto j = static_cast<std::size_t>(finest); j + 1 < regions.size(); ++j) regions[j + 1] = coarser(regions[j]);

  std::vector<float> points;  // empty: 0
  for (int j = group.octave; j >= finest; --j) {
    const CellRegion& r = regions[static_cast<std::size_t>(j)];
    if (!points.empty()) points = refined(points, regions[static_cast<std::size_t>(j) + 1], r);
    const CellReach reach(sheet, r, static_cast<double>(std::int64_t{1} << j),
                          j == group.octave ? group.cells : kHoleCells);
    const OpenCells cells = this->cells().within(group.sheet, j, reach.around(r), unusable);
    if (!cells.any) continue;
    if (points.empty()) points.resize(r.columns() * r.rows());
    join_shares(cells, r, reach, points);
  }
  if (std::all_of(points.begin(), points.end(), [](float e) { return e == 0; })) return std::nullopt;
  Shares found;
  const CellRegion& r = regions[static_cast<std::size_t>(finest)];
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

// Of the valid posts of a group in a piece of its sheet the one nearest to a place there. `valid` is scratch memory.
std::optional<LayerEdges::BorderPost> LayerEdges::nearest_valid(const LayerGroup& group, const CellRegion& cell,
                                                                double x_to, double y_to,
                                                                std::vector<char>& valid) const {
  std::vector<SourceIndex> unusable;
  double nearest = std::numeric_limits<double>::infinity();
  BorderPost post{-1, 0, 0};
  for (const int s : group.sources) {
    const RasterInfo& info = catalogue_.rasters()[static_cast<std::size_t>(s)];
    const auto [sx, sy] = groups().shift[static_cast<std::size_t>(s)];
    const std::int64_t x0 = std::max<std::int64_t>(cell.x0 - sx, 0), y0 = std::max<std::int64_t>(cell.y0 - sy, 0),
                       x1 = std::min<std::int64_t>(cell.x1 - sx, info.width),
                       y1 = std::min<std::int64_t>(cell.y1 - sy, info.height);
    if (x0 >= x1 || y0 >= y1) continue;
    const auto w = static_cast<int>(x1 - x0), h = static_cast<int>(y1 - y0);
    posts_.read(s, x0, y0, w, h, valid, unusable);
    for (int y = 0; y < h; ++y)
      for (int x = 0; x < w; ++x) {
        if (!valid[static_cast<std::size_t>(y) * static_cast<std::size_t>(w) + static_cast<std::size_t>(x)]) continue;
        const double distance =
            std::hypot(static_cast<double>(x0 + x + sx) - x_to, static_cast<double>(y0 + y + sy) - y_to);
        if (distance < nearest) nearest = distance, post = {s, static_cast<int>(x0) + x, static_cast<int>(y0) + y};
      }
  }
  if (post.source < 0) return std::nullopt;
  return post;
}

std::vector<LayerEdges::BorderPost> LayerEdges::border(int source, std::size_t most) const {
  if (!meets(source)) return {};
  const LayerGroup& group = settled(source);
  const LayerSheet& sheet = groups().sheets[static_cast<std::size_t>(group.sheet)];
  const auto around = static_cast<double>(2 * (group.x1 - group.x0 + group.y1 - group.y0));
  const double apart = std::min(group.spacing_ratio / 2, around / kLeastBorderPosts);
  int octave = std::max(0, static_cast<int>(std::floor(std::log2(std::max(apart, 1.0)))));
  while (sheet.globe % (std::int64_t{1} << octave) != 0) --octave;
  const std::int64_t cell = std::int64_t{1} << octave;
  const CellRegion r{floor_div(group.x0, cell) - 1, floor_div(group.y0, cell) - 1, floor_div(group.x1 - 1, cell) + 2,
                     floor_div(group.y1 - 1, cell) + 2};
  if ((r.x1 - r.x0) * (r.y1 - r.y0) > kMostBorderCells) return {};
  std::vector<SourceIndex> unusable;
  const OpenCells cells = this->cells().within(group.sheet, octave, r, unusable);
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
    // Nearest to the open cell's middle.
    const double tx = (static_cast<double>(b.x + b.dx) + 0.5) * static_cast<double>(cell) - 0.5,
                 ty = (static_cast<double>(b.y + b.dy) + 0.5) * static_cast<double>(cell) - 0.5;
    const CellRegion at{b.x * cell, b.y * cell, (b.x + 1) * cell, (b.y + 1) * cell};
    if (const auto post = nearest_valid(group, at, tx, ty, valid)) posts.push_back(*post);
  }
  return posts;
}

}  // namespace selenograph::dem
