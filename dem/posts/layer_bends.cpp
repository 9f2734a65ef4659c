#include "dem/posts/layer_bends.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace selenograph::dem {
namespace {

constexpr double kNearCells = 3;  // over which a finer octave gives way to the next coarser one
constexpr std::int64_t kMaxBorderCells = std::int64_t{1} << 24;
constexpr double kMinBorderPosts = 256;
constexpr int kBlockPlaces = 64;  // along a side of a block of places that shares one field

// 1 - smoothstep: 1 up to a distance of one cell, 0 from `width` cells further on.
double share_at(double distance, double width) {
  const double t = std::clamp((distance - 1) / width, 0.0, 1.0);
  return (1 - t) * (1 - t) * (1 + 2 * t);
}

// The cells of the next octave that the subdivision of a region needs.
CellRegion coarser(const CellRegion& r) {
  return {floor_div(r.x0, 2) - 1, floor_div(r.y0, 2) - 1, floor_div(r.x1 - 1, 2) + 2, floor_div(r.y1 - 1, 2) + 2};
}

// Chaikin's corner cutting in both directions: each cell takes 9/16 of its parent, and 3/16, 3/16 and 1/16 of those
// beside it.
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

// The part of a region where a group has posts. In a group that reaches around the globe columns have no end.
CellRegion within_group(const LayerGroup& group, const LayerSheet& sheet, std::int64_t cell, CellRegion r) {
  if (sheet.globe == 0 || 2 * (group.x1 - group.x0) < sheet.globe) {
    r.x0 = std::max(r.x0, floor_div(group.x0, cell));
    r.x1 = std::min(r.x1, floor_div(group.x1 - 1, cell) + 1);
  }
  r.y0 = std::max(r.y0, floor_div(group.y0, cell));
  r.y1 = std::min(r.y1, floor_div(group.y1 - 1, cell) + 1);
  return r;
}

}  // namespace

// c at the middles of a region's cells, and how far the border is, in posts.
struct LayerBends::Field {
  CellRegion region;
  std::vector<float> bend_m, away;

  // Bilinear, at a place in posts of the sheet; exact on posts.
  static float at(const CellRegion& r, const std::vector<float>& values, double x, double y) {
    const auto px = std::min(static_cast<std::int64_t>(std::floor(x)), r.x1 - 2),
               py = std::min(static_cast<std::int64_t>(std::floor(y)), r.y1 - 2);
    const double fx = x - static_cast<double>(px), fy = y - static_cast<double>(py);
    const auto value = [&](std::int64_t cx, std::int64_t cy) { return static_cast<double>(values[r.index(cx, cy)]); };
    return static_cast<float>((1 - fy) * ((1 - fx) * value(px, py) + fx * value(px + 1, py)) +
                              fy * ((1 - fx) * value(px, py + 1) + fx * value(px + 1, py + 1)));
  }
};

// The share of an octave at each cell of a region, its mean step and its distance from the border.
struct LayerBends::Shares {
  std::vector<float> share, step_m, away;
  bool any = false, all = false;
};

// Mean of what groups of one layer add at each place: a group counts the more the nearer it is, and alone at its
// border.
class LayerBends::Mixture {
 public:
  explicit Mixture(std::size_t places)
      : weight_(places), sum_(places), away_m_(places, std::numeric_limits<float>::infinity()) {}

  void add(std::size_t place, double bend_m, double away_posts, const LayerGroup& group) {
    constexpr double kOnBorder = 1e-6;
    const double share = share_at(1 + away_posts / group.band_posts, 1);
    if (!(share > 0)) return;
    const double weight = share / (away_posts * away_posts + kOnBorder);
    weight_[place] += weight;
    sum_[place] += weight * bend_m;
    away_m_[place] = std::min(away_m_[place], static_cast<float>(away_posts * group.post_spacing_m / share));
  }
  bool any() const {
    return std::any_of(weight_.begin(), weight_.end(), [](double w) { return w > 0; });
  }
  void add_to(Bends& bends) const {
    for (std::size_t i = 0; i < weight_.size(); ++i) {
      if (!(weight_[i] > 0)) continue;
      bends.added_m[i] += static_cast<float>(sum_[i] / weight_[i]);
      bends.away_m[i] = std::min(bends.away_m[i], away_m_[i]);
    }
  }

 private:
  std::vector<double> weight_, sum_;
  std::vector<float> away_m_;
};

void PlaceBox::add(const Geographic& place) {
  if (empty()) west_deg = east_deg = place.lon_deg;
  south_deg = std::min(south_deg, place.lat_deg);
  north_deg = std::max(north_deg, place.lat_deg);
  // Count from the box's middle, so that the date line is no border.
  const double middle_deg = (west_deg + east_deg) / 2;
  const double lon_deg = middle_deg + std::remainder(place.lon_deg - middle_deg, 360);
  west_deg = std::min(west_deg, lon_deg);
  east_deg = std::max(east_deg, lon_deg);
}

LayerBends::LayerBends(const Catalogue& catalogue, ReadPosts read, HeightsBeneath beneath, bool fall_through)
    : catalogue_(catalogue), read_(std::move(read)), beneath_(std::move(beneath)), fall_through_(fall_through) {}

LayerBends::~LayerBends() = default;

const LayerBends::Found& LayerBends::found() const {
  grouped_.run([&] { found_ = std::make_unique<Found>(catalogue_, read_, beneath_, fall_through_); });
  return *found_;
}

double LayerBends::band_posts(int source) const {
  if (catalogue_.layer_begin(source) == 0) return 0;
  const LayerGroups& all = found().groups;
  return all.groups[static_cast<std::size_t>(all.group[static_cast<std::size_t>(source)])]->band_posts;
}

const std::vector<int>& LayerBends::group_of(int source) const {
  const LayerGroups& all = found().groups;
  return all.groups[static_cast<std::size_t>(all.group[static_cast<std::size_t>(source)])]->sources;
}

LayerBends::Shares LayerBends::shares_of(const LayerGroup& group, int octave, const CellRegion& r,
                                         std::vector<SourceIndex>& unusable) const {
  const LayerSheet& sheet = found().groups.sheets[static_cast<std::size_t>(group.sheet)];
  const std::int64_t cell = std::int64_t{1} << octave;
  const double width = octave == group.octave ? group.band_cells : kNearCells, reach = width + 1;
  std::vector<double> scales;  // a column's width by a row's
  for (std::int64_t y = r.y0; y < r.y1; ++y)
    scales.push_back(sheet.column_scale((static_cast<double>(y) + 0.5) * static_cast<double>(cell)));
  const auto down = static_cast<std::int64_t>(std::ceil(reach)),
             along = static_cast<std::int64_t>(std::ceil(reach / *std::min_element(scales.begin(), scales.end())));
  Shares found;
  const CellRegion around = within_group(group, sheet, cell, {r.x0 - along, r.y0 - down, r.x1 + along, r.y1 + down});
  if (around.x0 >= around.x1 || around.y0 >= around.y1) return found;
  const std::vector<BorderCell> border = this->found().cells.within(group.sheet, octave, around, unusable);
  if (border.empty()) return found;
  const std::size_t n = r.columns() * r.rows();
  std::vector<double> nearest2(n, reach * reach), weights(n), sums(n);
  for (const BorderCell& b : border)
    for (std::int64_t y = std::max(r.y0, b.y - down); y < std::min(r.y1, b.y + down + 1); ++y) {
      const double scale = scales[static_cast<std::size_t>(y - r.y0)], dy = static_cast<double>(y - b.y);
      for (std::int64_t x = std::max(r.x0, b.x - along); x < std::min(r.x1, b.x + along + 1); ++x) {
        const double dx = scale * static_cast<double>(x - b.x), d2 = dx * dx + dy * dy;
        if (d2 >= reach * reach) continue;
        const std::size_t at = r.index(x, y);
        nearest2[at] = std::min(nearest2[at], d2);
        // A cell on the border has its own step.
        const double fade = 1 - d2 / (reach * reach);
        const double weight = static_cast<double>(b.samples) * fade * fade / std::max(d2 * d2, 1e-12);
        weights[at] += weight;
        sums[at] += weight * static_cast<double>(b.step_m);
      }
    }
  found.share.resize(n), found.step_m.resize(n), found.away.resize(n);
  found.all = true;
  for (std::size_t i = 0; i < n; ++i) {
    const double distance = std::sqrt(nearest2[i]);
    found.share[i] = weights[i] > 0 ? static_cast<float>(share_at(distance, width)) : 0;
    found.step_m[i] = weights[i] > 0 ? static_cast<float>(sums[i] / weights[i]) : 0;
    found.away[i] = static_cast<float>(distance * static_cast<double>(cell));
    found.any |= found.share[i] > 0;
    found.all &= found.share[i] == 1;
  }
  return found;
}

LayerBends::Field LayerBends::field(const LayerGroup& group, int octave, const CellRegion& r,
                                    std::vector<SourceIndex>& unusable) const {
  Field made{r, {}, {}};
  Shares shares = shares_of(group, octave, r, unusable);
  if (shares.all) {
    made.bend_m = std::move(shares.step_m);
    made.away = std::move(shares.away);
    return made;
  }
  const std::size_t n = r.columns() * r.rows();
  if (octave < group.octave) {
    const CellRegion from = coarser(r);
    const Field beyond = field(group, octave + 1, from, unusable);
    if (!beyond.bend_m.empty()) {
      made.bend_m = refined(beyond.bend_m, from, r);
      made.away = refined(beyond.away, from, r);
    }
  }
  if (!shares.any) return made;
  if (made.bend_m.empty()) {
    made.bend_m.assign(n, 0);
    made.away.assign(n, static_cast<float>(group.band_posts));
  }
  for (std::size_t i = 0; i < n; ++i) {
    const float share = shares.share[i];
    made.bend_m[i] = share == 1 ? shares.step_m[i] : made.bend_m[i] + share * (shares.step_m[i] - made.bend_m[i]);
    made.away[i] = share == 1 ? shares.away[i] : made.away[i] + share * (shares.away[i] - made.away[i]);
  }
  return made;
}

// Groups whose bands may reach a place of the grid with a coarser source, from coarse to fine.
std::vector<const LayerGroup*> LayerBends::groups_near(const PlaceGrid& places, int past) const {
  std::vector<const LayerGroup*> near;
  if (past == 0) return near;
  const int finest_begin = catalogue_.layer_begin(past - 1);
  int coarsest = past;
  PlaceBox box;
  for (int r = 0; r < places.rows; ++r)
    for (int c = 0; c < places.columns; ++c) {
      const SourceMark mark = places.sources[places.index(r, c)];
      if (!can_bend(mark, finest_begin)) continue;
      coarsest = std::min(coarsest, catalogue_.layer_begin(static_cast<int>(source_of(mark))));
      box.add(places.place(r, c));
    }
  if (box.empty()) return near;
  const double band_deg = 1.2 * widest_band_deg();
  const double poleward_deg = std::max(-box.south_deg, box.north_deg) + band_deg;
  const double beside_deg = poleward_deg >= 89 ? 360 : band_deg / std::cos(poleward_deg * kRadiansPerDegree);
  const std::vector<int> files =
      catalogue_.touching(box.south_deg, box.north_deg, box.west_deg - beside_deg, box.east_deg + beside_deg, band_deg);
  const LayerGroups& all = found().groups;
  for (const int file : files) {
    if (file >= past || catalogue_.layer_begin(file) <= coarsest) continue;
    const LayerGroup* group = all.groups[static_cast<std::size_t>(all.group[static_cast<std::size_t>(file)])].get();
    if (group->band_posts > 0 && std::find(near.begin(), near.end(), group) == near.end()) near.push_back(group);
  }
  std::sort(near.begin(), near.end(),
            [](const LayerGroup* a, const LayerGroup* b) { return a->sources.front() < b->sources.front(); });
  return near;
}

Bends LayerBends::at(const PlaceGrid& places, int past) const {
  Bends bends;
  if (!(catalogue_.joins().blend_posts > 0) || catalogue_.one_layer()) return bends;
  const std::vector<const LayerGroup*> near = groups_near(places, past);
  for (auto first = near.begin(); first != near.end();) {
    Mixture mixture(places.sources.size());
    auto group = first;
    for (; group != near.end() && (*group)->layer_begin == (*first)->layer_begin; ++group)
      add_group(**group, places, mixture, bends.unusable);
    if (mixture.any()) {
      bends.added_m.resize(places.sources.size());
      bends.away_m.resize(places.sources.size(), std::numeric_limits<float>::infinity());
      mixture.add_to(bends);
    }
    first = group;
  }
  return bends;
}

// Adds the group's part at places where coarser layers show, block by block.
void LayerBends::add_group(const LayerGroup& group, const PlaceGrid& places, Mixture& mixture,
                           std::vector<SourceIndex>& unusable) const {
  const LayerSheet& sheet = found().groups.sheets[static_cast<std::size_t>(group.sheet)];
  const SheetPosts posts(sheet, group);
  std::vector<std::size_t> indices;
  std::vector<PostXY> at;
  for (int r0 = 0; r0 < places.rows; r0 += kBlockPlaces)
    for (int c0 = 0; c0 < places.columns; c0 += kBlockPlaces) {
      indices.clear();
      at.clear();
      for (int r = r0; r < std::min(r0 + kBlockPlaces, places.rows); ++r)
        for (int c = c0; c < std::min(c0 + kBlockPlaces, places.columns); ++c) {
          const std::size_t i = places.index(r, c);
          if (!can_bend(places.sources[i], group.layer_begin)) continue;
          const PostXY p = posts.locate(places.place(r, c));
          if (posts.away_from_box(p) > group.band_posts) continue;
          indices.push_back(i);
          at.push_back(p);
        }
      if (!indices.empty()) add_block(group, indices, at, mixture, unusable);
    }
}

// One field for all places if they lie densely among the group's posts, else one for each.
void LayerBends::add_block(const LayerGroup& group, const std::vector<std::size_t>& indices,
                           const std::vector<PostXY>& at, Mixture& mixture, std::vector<SourceIndex>& unusable) const {
  constexpr double kMaxCellsPerPlace = 16;
  const auto first = [](double v) { return static_cast<std::int64_t>(std::floor(v)); };
  const auto region_of = [&](std::span<const PostXY> some) {
    CellRegion r{first(some[0].x), first(some[0].y), first(some[0].x) + 2, first(some[0].y) + 2};
    for (const PostXY& p : some) {
      r.x0 = std::min(r.x0, first(p.x)), r.x1 = std::max(r.x1, first(p.x) + 2);
      r.y0 = std::min(r.y0, first(p.y)), r.y1 = std::max(r.y1, first(p.y) + 2);
    }
    return r;
  };
  const auto add = [&](std::size_t from, std::size_t to) {
    const CellRegion r = region_of(std::span(at).subspan(from, to - from));
    const Field made = field(group, 0, r, unusable);
    if (made.bend_m.empty()) return;
    for (std::size_t i = from; i < to; ++i)
      mixture.add(indices[i], static_cast<double>(Field::at(r, made.bend_m, at[i].x, at[i].y)),
                  static_cast<double>(Field::at(r, made.away, at[i].x, at[i].y)), group);
  };
  const CellRegion all = region_of(at);
  const double cells = static_cast<double>(all.x1 - all.x0) * static_cast<double>(all.y1 - all.y0);
  if (cells <= kMaxCellsPerPlace * static_cast<double>(at.size()) + kMaxCellsPerPlace) {
    add(0, at.size());
    return;
  }
  for (std::size_t i = 0; i < at.size(); ++i) add(i, i + 1);
}

std::vector<BorderPost> LayerBends::border(int source, std::size_t most) const {
  if (catalogue_.layer_begin(source) == 0) return {};
  const LayerGroups& all = found().groups;
  const LayerGroup& group = *all.groups[static_cast<std::size_t>(all.group[static_cast<std::size_t>(source)])];
  if (group.beneath < 0) return {};
  const LayerSheet& sheet = all.sheets[static_cast<std::size_t>(group.sheet)];
  const auto around = static_cast<double>(2 * (group.x1 - group.x0 + group.y1 - group.y0));
  const double apart = std::max(1.0, std::min(group.spacing_ratio / 2, around / kMinBorderPosts));
  // A cell's samples are a quarter of its side apart.
  const int octave = sheet.octave_up_to(static_cast<int>(std::floor(std::log2(apart))) + 2);
  const std::int64_t cell = std::int64_t{1} << octave;
  const CellRegion r{floor_div(group.x0, cell), floor_div(group.y0, cell), floor_div(group.x1 - 1, cell) + 1,
                     floor_div(group.y1 - 1, cell) + 1};
  if ((r.x1 - r.x0) * (r.y1 - r.y0) > kMaxBorderCells) return {};
  std::vector<BorderPost> found = this->found().cells.posts(group.sheet, octave, r);
  std::erase_if(found, [&](const BorderPost& post) {
    return !std::binary_search(group.sources.begin(), group.sources.end(), post.source);
  });
  const std::size_t step = std::max<std::size_t>(1, (found.size() + most - 1) / std::max<std::size_t>(most, 1));
  std::vector<BorderPost> posts;
  for (std::size_t i = 0; i < found.size(); i += step) posts.push_back(found[i]);
  return posts;
}

}  // namespace selenograph::dem
