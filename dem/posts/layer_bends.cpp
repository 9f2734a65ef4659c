#include "dem/posts/layer_bends.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace selenograph::dem {
namespace {

constexpr double kFadeCells = 3;  // cells over which a finer octave fades into the next coarser one
constexpr std::int64_t kMaxBorderCells = std::int64_t{1} << 24;
constexpr double kMinBorderPosts = 256;
constexpr int kBlockSide = 64;  // positions along a side of a block that shares one field

// Returns the share of an octave's own steps at a distance from the border, in cells: 1 up to one cell, falling
// smoothly (1 - smoothstep) to 0 at 1 + width cells.
double share_at(double distance, double width) {
  const double t = std::clamp((distance - 1) / width, 0.0, 1.0);
  return (1 - t) * (1 - t) * (1 + 2 * t);
}

// Returns the cells of the next coarser octave that the subdivision of a region needs.
CellRegion parent_region(const CellRegion& r) {
  return {floor_div(r.x0, 2) - 1, floor_div(r.y0, 2) - 1, floor_div(r.x1 - 1, 2) + 2, floor_div(r.y1 - 1, 2) + 2};
}

// Subdivides by Chaikin's corner cutting in both directions: each cell gets 9/16 of its parent, 3/16 of the parent's
// nearest neighbours in x and in y, and 1/16 of the diagonal one.
std::vector<float> subdivide(const std::vector<float>& coarse, const CellRegion& coarse_region,
                             const CellRegion& fine_region) {
  std::vector<float> fine(fine_region.columns() * fine_region.rows());
  // Returns the parent's neighbour on the side where the child lies in its parent.
  const auto neighbour_of = [](std::int64_t child, std::int64_t parent) {
    return child == 2 * parent ? parent - 1 : parent + 1;
  };
  for (std::int64_t y = fine_region.y0; y < fine_region.y1; ++y) {
    const std::int64_t parent_y = floor_div(y, 2), neighbour_y = neighbour_of(y, parent_y);
    for (std::int64_t x = fine_region.x0; x < fine_region.x1; ++x) {
      const std::int64_t parent_x = floor_div(x, 2), neighbour_x = neighbour_of(x, parent_x);
      fine[fine_region.index(x, y)] = 0.5625F * coarse[coarse_region.index(parent_x, parent_y)] +
                                      0.1875F * coarse[coarse_region.index(neighbour_x, parent_y)] +
                                      0.1875F * coarse[coarse_region.index(parent_x, neighbour_y)] +
                                      0.0625F * coarse[coarse_region.index(neighbour_x, neighbour_y)];
    }
  }
  return fine;
}

// Returns the region clipped to the cells of a group's posts; a cell is `cell_posts` posts wide. The columns
// of a group wider than half the globe are not clipped.
CellRegion clip_to_group(const LayerGroup& group, const LayerSheet& sheet, std::int64_t cell_posts, CellRegion r) {
  if (sheet.globe == 0 || 2 * (group.x1 - group.x0) < sheet.globe) {
    r.x0 = std::max(r.x0, floor_div(group.x0, cell_posts));
    r.x1 = std::min(r.x1, floor_div(group.x1 - 1, cell_posts) + 1);
  }
  r.y0 = std::max(r.y0, floor_div(group.y0, cell_posts));
  r.y1 = std::min(r.y1, floor_div(group.y1 - 1, cell_posts) + 1);
  return r;
}

}  // namespace

// The bend c (layer_bends.h) at the centres of a region's cells, and their distance from the border. Empty vectors: the
// region is beyond the band.
struct LayerBends::Field {
  CellRegion region;
  std::vector<float> bend_m, distance_posts;

  // Returns a bilinear sample at column x and row y of the sheet, for a region of octave 0, whose cells are posts.
  static float sample(const CellRegion& r, const std::vector<float>& values, double x, double y) {
    const std::int64_t px = std::min(static_cast<std::int64_t>(std::floor(x)), r.x1 - 2);
    const std::int64_t py = std::min(static_cast<std::int64_t>(std::floor(y)), r.y1 - 2);
    const double fx = x - static_cast<double>(px), fy = y - static_cast<double>(py);
    const auto value = [&](std::int64_t cx, std::int64_t cy) { return static_cast<double>(values[r.index(cx, cy)]); };
    return static_cast<float>((1 - fy) * ((1 - fx) * value(px, py) + fx * value(px + 1, py)) +
                              fy * ((1 - fx) * value(px, py + 1) + fx * value(px + 1, py + 1)));
  }
};

// Contribution of one octave to each cell of a region: its share, 0 to 1, its mean step and the distance from the
// border.
struct LayerBends::OctaveShares {
  std::vector<float> share, step_m, distance_posts;
  bool any_share = false;   // at least one cell has a share above 0
  bool full_share = false;  // all cells have share 1: coarser octaves do not matter
};

// Weighted mean of the bends of one layer's groups at each position. The weight falls with the squared distance, so
// that at a group's border its own bend counts alone.
class LayerBends::BendMixture {
 public:
  explicit BendMixture(std::size_t count)
      : weight_(count), sum_m_(count), finer_distance_m_(count, std::numeric_limits<float>::infinity()) {}

  // Adds a group's bend at a position that is `distance_posts` from the group's border.
  void add(std::size_t position, double bend_m, double distance_posts, const LayerGroup& group) {
    constexpr double kOnBorder = 1e-6;  // keeps the weight finite on the border
    // The share falls from 1 on the border to 0 at the outer edge of the band.
    const double share = share_at(1 + distance_posts / group.band_posts, 1);
    if (!(share > 0)) return;
    const double weight = share / (distance_posts * distance_posts + kOnBorder);
    weight_[position] += weight;
    sum_m_[position] += weight * bend_m;
    // Divide by the share: the distance then grows to infinity at the edge of the band, without a step.
    finer_distance_m_[position] =
        std::min(finer_distance_m_[position], static_cast<float>(distance_posts * group.post_spacing_m / share));
  }
  bool has_bends() const {
    return std::any_of(weight_.begin(), weight_.end(), [](double w) { return w > 0; });
  }
  // Adds the means to the bends of the layers added before.
  void add_to(Bends& bends) const {
    for (std::size_t i = 0; i < weight_.size(); ++i) {
      if (!(weight_[i] > 0)) continue;
      bends.added_m[i] += static_cast<float>(sum_m_[i] / weight_[i]);
      bends.finer_distance_m[i] = std::min(bends.finer_distance_m[i], finer_distance_m_[i]);
    }
  }

 private:
  std::vector<double> weight_, sum_m_;
  std::vector<float> finer_distance_m_;
};

void PositionBox::add(const Geographic& position) {
  if (empty()) west_deg = east_deg = position.lon_deg;
  south_deg = std::min(south_deg, position.lat_deg);
  north_deg = std::max(north_deg, position.lat_deg);
  // Count longitudes from the box's middle, so that the date line needs no special case.
  const double middle_deg = (west_deg + east_deg) / 2;
  const double lon_deg = middle_deg + std::remainder(position.lon_deg - middle_deg, 360);
  west_deg = std::min(west_deg, lon_deg);
  east_deg = std::max(east_deg, lon_deg);
}

LayerBends::LayerBends(const Catalogue& catalogue, ReadPosts read, HeightsBeneath beneath, bool fall_through)
    : catalogue_(catalogue), read_(std::move(read)), beneath_(std::move(beneath)), fall_through_(fall_through) {}

LayerBends::~LayerBends() = default;

const LayerBends::Grouping& LayerBends::grouping() const {
  grouped_.run([&] { grouping_ = std::make_unique<Grouping>(catalogue_, read_, beneath_, fall_through_); });
  return *grouping_;
}

double LayerBends::band_posts(int source) const {
  if (catalogue_.layer_begin(source) == 0) return 0;
  const LayerGroups& grouped = grouping().groups;
  return grouped.groups[static_cast<std::size_t>(grouped.group[static_cast<std::size_t>(source)])]->band_posts;
}

const std::vector<int>& LayerBends::group_of(int source) const {
  const LayerGroups& grouped = grouping().groups;
  return grouped.groups[static_cast<std::size_t>(grouped.group[static_cast<std::size_t>(source)])]->sources;
}

// Computes, for each cell of a region, the mean step of the border cells around it and the octave's share there. Border
// cells are weighted by their samples, by distance^-4, and by a fade to 0 at the octave's reach. Distances are in
// cells.
LayerBends::OctaveShares LayerBends::compute_shares(const LayerGroup& group, int octave, const CellRegion& r,
                                                    std::vector<SourceIndex>& unusable) const {
  const LayerSheet& sheet = grouping().groups.sheets[static_cast<std::size_t>(group.sheet)];
  const std::int64_t cell_posts = std::int64_t{1} << octave;
  // The coarsest octave fades over the whole band, every finer one over kFadeCells.
  const double fade_cells = octave == group.octave ? group.band_cells : kFadeCells, reach = fade_cells + 1;
  std::vector<double> scales;  // ratio of a column's width to a row's, per row
  for (std::int64_t y = r.y0; y < r.y1; ++y)
    scales.push_back(sheet.column_scale((static_cast<double>(y) + 0.5) * static_cast<double>(cell_posts)));
  const double narrowest_scale = *std::min_element(scales.begin(), scales.end());
  const auto reach_rows = static_cast<std::int64_t>(std::ceil(reach));
  const auto reach_columns = static_cast<std::int64_t>(std::ceil(reach / narrowest_scale));
  OctaveShares shares;
  const CellRegion search = clip_to_group(
      group, sheet, cell_posts, {r.x0 - reach_columns, r.y0 - reach_rows, r.x1 + reach_columns, r.y1 + reach_rows});
  if (search.x0 >= search.x1 || search.y0 >= search.y1) return shares;
  const std::vector<BorderCell> border = grouping().cells.cells_in(group.sheet, octave, search, unusable);
  if (border.empty()) return shares;
  const std::size_t n = r.columns() * r.rows();
  std::vector<double> nearest_squared(n, reach * reach), weights(n), sums_m(n);
  for (const BorderCell& b : border)
    for (std::int64_t y = std::max(r.y0, b.y - reach_rows); y < std::min(r.y1, b.y + reach_rows + 1); ++y) {
      const double scale = scales[static_cast<std::size_t>(y - r.y0)], dy = static_cast<double>(y - b.y);
      for (std::int64_t x = std::max(r.x0, b.x - reach_columns); x < std::min(r.x1, b.x + reach_columns + 1); ++x) {
        const double dx = scale * static_cast<double>(x - b.x), d2 = dx * dx + dy * dy;
        if (d2 >= reach * reach) continue;
        const std::size_t cell = r.index(x, y);
        nearest_squared[cell] = std::min(nearest_squared[cell], d2);
        // Limit the divisor: at distance 0 the weight is so large that a border cell gets its own step.
        const double fade = 1 - d2 / (reach * reach);
        const double weight = static_cast<double>(b.samples) * fade * fade / std::max(d2 * d2, 1e-12);
        weights[cell] += weight;
        sums_m[cell] += weight * static_cast<double>(b.step_m);
      }
    }
  shares.share.resize(n);
  shares.step_m.resize(n);
  shares.distance_posts.resize(n);
  shares.full_share = true;
  for (std::size_t i = 0; i < n; ++i) {
    const double distance = std::sqrt(nearest_squared[i]);
    shares.share[i] = weights[i] > 0 ? static_cast<float>(share_at(distance, fade_cells)) : 0;
    shares.step_m[i] = weights[i] > 0 ? static_cast<float>(sums_m[i] / weights[i]) : 0;
    shares.distance_posts[i] = static_cast<float>(distance * static_cast<double>(cell_posts));
    shares.any_share |= shares.share[i] > 0;
    shares.full_share &= shares.share[i] == 1;
  }
  return shares;
}

// Computes the bend c over a region of one octave: share * the octave's own mean step + (1 - share) * the field of the
// next coarser octave, subdivided. Computes that field only if a cell's share is below 1.
LayerBends::Field LayerBends::compute_field(const LayerGroup& group, int octave, const CellRegion& r,
                                            std::vector<SourceIndex>& unusable) const {
  Field field{r, {}, {}};
  OctaveShares shares = compute_shares(group, octave, r, unusable);
  if (shares.full_share) {
    field.bend_m = std::move(shares.step_m);
    field.distance_posts = std::move(shares.distance_posts);
    return field;
  }
  const std::size_t n = r.columns() * r.rows();
  if (octave < group.octave) {
    const CellRegion from = parent_region(r);
    const Field coarse_field = compute_field(group, octave + 1, from, unusable);
    if (!coarse_field.bend_m.empty()) {
      field.bend_m = subdivide(coarse_field.bend_m, from, r);
      field.distance_posts = subdivide(coarse_field.distance_posts, from, r);
    }
  }
  if (!shares.any_share) return field;
  if (field.bend_m.empty()) {
    field.bend_m.assign(n, 0);
    field.distance_posts.assign(n, static_cast<float>(group.band_posts));
  }
  for (std::size_t i = 0; i < n; ++i) {
    // Take values with share 1 as they are: interpolation would round the step of a border post.
    const float share = shares.share[i];
    field.bend_m[i] = share == 1 ? shares.step_m[i] : field.bend_m[i] + share * (shares.step_m[i] - field.bend_m[i]);
    field.distance_posts[i] =
        share == 1 ? shares.distance_posts[i]
                   : field.distance_posts[i] + share * (shares.distance_posts[i] - field.distance_posts[i]);
  }
  return field;
}

// Returns the groups of the first `past_file` files whose bands may reach a position of the grid that shows a layer
// coarser than theirs, from coarse to fine.
std::vector<const LayerGroup*> LayerBends::groups_near(const PositionGrid& grid, int past_file) const {
  std::vector<const LayerGroup*> near;
  if (past_file == 0) return near;
  const int finest_begin = catalogue_.layer_begin(past_file - 1);
  int coarsest_begin = past_file;  // first file of the coarsest layer that the grid shows
  PositionBox box;                 // around the positions that can be bent
  for (int r = 0; r < grid.rows; ++r)
    for (int c = 0; c < grid.columns; ++c) {
      const SourceMark mark = grid.sources[grid.index(r, c)];
      if (!can_bend(mark, finest_begin)) continue;
      coarsest_begin = std::min(coarsest_begin, catalogue_.layer_begin(static_cast<int>(source_of(mark))));
      box.add(grid.position(r, c));
    }
  if (box.empty()) return near;
  constexpr double kMarginFactor = 1.2;
  const double band_deg = kMarginFactor * widest_band_deg();
  // Convert the band's width to longitudes at the most poleward latitude.
  const double poleward_deg = std::max(-box.south_deg, box.north_deg) + band_deg;
  const double band_lon_deg = poleward_deg >= 89 ? 360 : band_deg / std::cos(poleward_deg * kRadiansPerDegree);
  const std::vector<int> files = catalogue_.touching(box.south_deg, box.north_deg, box.west_deg - band_lon_deg,
                                                     box.east_deg + band_lon_deg, band_deg);
  const LayerGroups& grouped = grouping().groups;
  for (const int file : files) {
    if (file >= past_file || catalogue_.layer_begin(file) <= coarsest_begin) continue;
    const LayerGroup* group =
        grouped.groups[static_cast<std::size_t>(grouped.group[static_cast<std::size_t>(file)])].get();
    if (group->band_posts > 0 && std::find(near.begin(), near.end(), group) == near.end()) near.push_back(group);
  }
  std::sort(near.begin(), near.end(),
            [](const LayerGroup* a, const LayerGroup* b) { return a->sources.front() < b->sources.front(); });
  return near;
}

// Adds the bends layer by layer, from coarse to fine.
Bends LayerBends::bends_at(const PositionGrid& grid, int past_file) const {
  Bends bends;
  if (!(catalogue_.joins().blend_posts > 0) || catalogue_.one_layer()) return bends;
  const std::vector<const LayerGroup*> near = groups_near(grid, past_file);
  for (auto first = near.begin(); first != near.end();) {
    // Average the bends of one layer's groups, then add the layers' means.
    BendMixture mixture(grid.sources.size());
    auto group = first;
    for (; group != near.end() && (*group)->layer_begin == (*first)->layer_begin; ++group)
      add_group(**group, grid, mixture, bends.unusable);
    if (mixture.has_bends()) {
      bends.added_m.resize(grid.sources.size());
      bends.finer_distance_m.resize(grid.sources.size(), std::numeric_limits<float>::infinity());
      mixture.add_to(bends);
    }
    first = group;
  }
  return bends;
}

// Adds a group's bends at positions that show coarser layers, block by block.
void LayerBends::add_group(const LayerGroup& group, const PositionGrid& grid, BendMixture& mixture,
                           std::vector<SourceIndex>& unusable) const {
  const LayerSheet& sheet = grouping().groups.sheets[static_cast<std::size_t>(group.sheet)];
  const SheetPosts posts(sheet, group);
  std::vector<std::size_t> indices;
  std::vector<PostXY> positions;  // of a block, in columns and rows of the sheet
  for (int r0 = 0; r0 < grid.rows; r0 += kBlockSide)
    for (int c0 = 0; c0 < grid.columns; c0 += kBlockSide) {
      indices.clear();
      positions.clear();
      for (int r = r0; r < std::min(r0 + kBlockSide, grid.rows); ++r)
        for (int c = c0; c < std::min(c0 + kBlockSide, grid.columns); ++c) {
          const std::size_t i = grid.index(r, c);
          if (!can_bend(grid.sources[i], group.layer_begin)) continue;
          const PostXY p = posts.locate(grid.position(r, c));
          if (posts.distance_from_box(p) > group.band_posts) continue;
          indices.push_back(i);
          positions.push_back(p);
        }
      if (!indices.empty()) add_block(group, indices, positions, mixture, unusable);
    }
}

// Adds a group's bends at positions of a block, in columns and rows of the sheet, whose indices in the grid are
// `indices`. Computes one field for all of them if they lie densely among the group's posts, else one for each.
void LayerBends::add_block(const LayerGroup& group, const std::vector<std::size_t>& indices,
                           const std::vector<PostXY>& positions, BendMixture& mixture,
                           std::vector<SourceIndex>& unusable) const {
  constexpr double kMaxCellsPerPosition = 16;
  const auto index_below = [](double v) { return static_cast<std::int64_t>(std::floor(v)); };
  // Returns the posts around positions that bilinear sampling needs.
  const auto region_of = [&](std::span<const PostXY> points) {
    CellRegion r{index_below(points[0].x), index_below(points[0].y), index_below(points[0].x) + 2,
                 index_below(points[0].y) + 2};
    for (const PostXY& p : points) {
      r.x0 = std::min(r.x0, index_below(p.x));
      r.x1 = std::max(r.x1, index_below(p.x) + 2);
      r.y0 = std::min(r.y0, index_below(p.y));
      r.y1 = std::max(r.y1, index_below(p.y) + 2);
    }
    return r;
  };
  const auto add_range = [&](std::size_t from, std::size_t to) {
    const CellRegion r = region_of(std::span(positions).subspan(from, to - from));
    const Field field = compute_field(group, 0, r, unusable);
    if (field.bend_m.empty()) return;
    for (std::size_t i = from; i < to; ++i)
      mixture.add(indices[i], static_cast<double>(Field::sample(r, field.bend_m, positions[i].x, positions[i].y)),
                  static_cast<double>(Field::sample(r, field.distance_posts, positions[i].x, positions[i].y)), group);
  };
  const CellRegion region = region_of(positions);
  const double cells = static_cast<double>(region.x1 - region.x0) * static_cast<double>(region.y1 - region.y0);
  if (cells <= kMaxCellsPerPosition * static_cast<double>(positions.size()) + kMaxCellsPerPosition) {
    add_range(0, positions.size());
    return;
  }
  for (std::size_t i = 0; i < positions.size(); ++i) add_range(i, i + 1);
}

// Takes the border samples of cells of a suitable octave over the group's box, thinned to `max_posts`.
std::vector<BorderPost> LayerBends::border_posts(int source, std::size_t max_posts) const {
  if (catalogue_.layer_begin(source) == 0) return {};
  const LayerGroups& grouped = grouping().groups;
  const LayerGroup& group = *grouped.groups[static_cast<std::size_t>(grouped.group[static_cast<std::size_t>(source)])];
  if (group.beneath < 0) return {};
  const LayerSheet& sheet = grouped.sheets[static_cast<std::size_t>(group.sheet)];
  const auto perimeter_posts = static_cast<double>(2 * (group.x1 - group.x0 + group.y1 - group.y0));
  const double spacing_posts = std::max(1.0, std::min(group.spacing_ratio / 2, perimeter_posts / kMinBorderPosts));
  // A cell's samples are a quarter of its side apart: choose the cells four times as wide as the spacing.
  const int octave = sheet.octave_up_to(static_cast<int>(std::floor(std::log2(spacing_posts))) + 2);
  const std::int64_t cell_posts = std::int64_t{1} << octave;
  const CellRegion r{floor_div(group.x0, cell_posts), floor_div(group.y0, cell_posts),
                     floor_div(group.x1 - 1, cell_posts) + 1, floor_div(group.y1 - 1, cell_posts) + 1};
  if ((r.x1 - r.x0) * (r.y1 - r.y0) > kMaxBorderCells) return {};
  std::vector<BorderPost> candidates = grouping().cells.posts_in(group.sheet, octave, r);
  // Other groups of the sheet may have posts in the box: drop these.
  std::erase_if(candidates, [&](const BorderPost& post) {
    return !std::binary_search(group.sources.begin(), group.sources.end(), post.source);
  });
  const std::size_t step =
      std::max<std::size_t>(1, (candidates.size() + max_posts - 1) / std::max<std::size_t>(max_posts, 1));
  std::vector<BorderPost> posts;
  for (std::size_t i = 0; i < candidates.size(); i += step) posts.push_back(candidates[i]);
  return posts;
}

}  // namespace selenograph::dem
