#include "dem/posts/layer_groups.h"

#include <numeric>

#include "dem/grid/grid_shift.h"

namespace selenograph::dem {
namespace {

// Returns the posts of a row per turn around the globe; 0 if rows do not run around it.
double posts_around(const PostGrid& grid) {
  if (const auto* g = std::get_if<GeographicGrid>(&grid)) return 360 * g->lon_posts_per_degree;
  const auto& g = std::get<PlaneGrid>(grid);
  if (g.plane.projection != MapProjection::mercator) return 0;
  return 360 * kMetresPerDegree * g.plane.scale / g.spacing_m;
}

// Assigns each file of a finer layer to a sheet of its layer with the same grid, or to a new one.
void find_sheets(const Catalogue& catalogue, LayerGroups& result) {
  const std::vector<RasterInfo>& rasters = catalogue.rasters();
  const std::size_t n = rasters.size();
  for (std::size_t i = 0; i < n; ++i) {
    const int begin = catalogue.layer_begin(static_cast<int>(i));
    if (begin == 0) continue;
    // Search the layer's sheets, which are the last ones: files come layer by layer. `s`: sheet after the one tried.
    std::optional<std::pair<std::int64_t, std::int64_t>> shift;
    std::size_t s = result.sheets.size();
    while (s > 0 && result.sheets[s - 1].layer_begin == begin) {
      shift = shift_between(result.sheets[s - 1].reference->grid, rasters[i].grid);
      if (shift) break;
      --s;
    }
    if (!shift) {
      LayerSheet sheet{&rasters[i], begin, 0, {}};
      const double around = posts_around(rasters[i].grid);
      if (std::abs(around - std::round(around)) < 1e-6) sheet.globe = std::llround(around);
      result.sheets.push_back(std::move(sheet));
      s = result.sheets.size();
      shift = {0, 0};
    }
    result.sheets[s - 1].sources.push_back(static_cast<int>(i));
    result.sheet[i] = static_cast<int>(s) - 1;
    result.shift[i] = *shift;
  }
}

// Returns, for each file, the first file of its group: connected components of touching files, by union-find.
std::vector<int> find_touching(const Catalogue& catalogue, const LayerGroups& result) {
  const std::vector<RasterInfo>& rasters = catalogue.rasters();
  const std::size_t n = rasters.size();
  std::vector<int> root(n);
  std::iota(root.begin(), root.end(), 0);
  const auto root_of = [&](int i) {
    // Halve the path to the root while walking along it.
    while (root[static_cast<std::size_t>(i)] != i)
      i = root[static_cast<std::size_t>(i)] = root[static_cast<std::size_t>(root[static_cast<std::size_t>(i)])];
    return i;
  };
  for (std::size_t i = 0; i < n; ++i) {
    if (result.sheet[i] < 0) continue;
    const Footprint& f = rasters[i].footprint;
    for (const int neighbour :
         catalogue.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, 2 * widest_post_deg(rasters[i]))) {
      if (result.sheet[static_cast<std::size_t>(neighbour)] != result.sheet[i]) continue;
      const int a = root_of(static_cast<int>(i)), b = root_of(neighbour);
      root[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
    }
  }
  for (std::size_t i = 0; i < n; ++i) root[i] = root_of(static_cast<int>(i));
  return root;
}

// Creates the groups and extends each group's box by its files. `first_of`: result of find_touching().
void gather_groups(const std::vector<RasterInfo>& rasters, const std::vector<int>& first_of, LayerGroups& result) {
  for (std::size_t i = 0; i < rasters.size(); ++i) {
    if (result.sheet[i] < 0) continue;
    const auto first = static_cast<std::size_t>(first_of[i]);
    const auto [x, y] = result.shift[i];
    const RasterInfo& info = rasters[i];
    if (first == i) {
      result.group[i] = static_cast<int>(result.groups.size());
      auto group = std::make_unique<LayerGroup>();
      group->sheet = result.sheet[i];
      group->layer_begin = result.sheets[static_cast<std::size_t>(group->sheet)].layer_begin;
      group->post_spacing_m = info.post_spacing_m;
      group->x0 = x;
      group->y0 = y;
      group->x1 = x + info.width;
      group->y1 = y + info.height;
      result.groups.push_back(std::move(group));
    }
    result.group[i] = result.group[first];
    LayerGroup& group = *result.groups[static_cast<std::size_t>(result.group[i])];
    group.sources.push_back(static_cast<int>(i));
    // A group across the date line is one box: count each file's columns from its first file on.
    const std::int64_t globe = result.sheets[static_cast<std::size_t>(group.sheet)].globe;
    const std::int64_t turn_posts =
        globe == 0
            ? 0
            : globe * std::llround(static_cast<double>(result.shift[first].first - x) / static_cast<double>(globe));
    group.x0 = std::min(group.x0, x + turn_posts);
    group.x1 = std::max(group.x1, x + turn_posts + info.width);
    group.y0 = std::min(group.y0, y);
    group.y1 = std::max(group.y1, y + info.height);
  }
}

// Returns the index of the finest file before `begin` that overlaps a file by more than a border; -1: none.
int finest_beneath(const Catalogue& catalogue, int source, int begin) {
  constexpr double kBorder_deg = 1e-6;  // 3 cm: layers with only a border in common do not overlap
  const Footprint& f = catalogue.rasters()[static_cast<std::size_t>(source)].footprint;
  const std::vector<int> overlapping =
      catalogue.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, -kBorder_deg);
  const auto past = std::lower_bound(overlapping.begin(), overlapping.end(), begin);  // files ascend, so layers do
  return past == overlapping.begin() ? -1 : *std::prev(past);
}

// Sets each group's coarser file, band width and coarsest octave.
void set_bands(const Catalogue& catalogue, LayerGroups& result) {
  constexpr int kBandCells = 8;  // minimum width of the band in cells of its coarsest octave
  for (const auto& group : result.groups) {
    for (const int source : group->sources)
      group->beneath = std::max(group->beneath, finest_beneath(catalogue, source, group->layer_begin));
    if (group->beneath < 0) continue;
    group->spacing_ratio =
        catalogue.rasters()[static_cast<std::size_t>(group->beneath)].post_spacing_m / group->post_spacing_m;
    group->band_posts = catalogue.joins().blend_posts * group->spacing_ratio;
    if (!(group->band_posts > 0)) continue;
    // Limit the cells to the group's shorter side: at least four samples then fall on it.
    const auto side = static_cast<double>(std::min(group->x1 - group->x0, group->y1 - group->y0));
    const double cell = std::max(1.0, std::min(group->band_posts / kBandCells, side));
    group->octave = result.sheets[static_cast<std::size_t>(group->sheet)].octave_up_to(
        static_cast<int>(std::floor(std::log2(cell))));
    // Subtract the distance by which cell centres and the subdivision reach further.
    group->band_cells = std::max(1.0, group->band_posts / std::ldexp(1.0, group->octave) - 3);
    result.widest_band_deg =
        std::max(result.widest_band_deg, group->band_posts * group->post_spacing_m / kMetresPerDegree);
  }
}

}  // namespace

std::pair<int, int> LayerGroups::post_in_file(const Catalogue& catalogue, int source, std::int64_t x,
                                              std::int64_t y) const {
  const auto [shift_x, shift_y] = shift[static_cast<std::size_t>(source)];
  const std::int64_t globe = sheets[static_cast<std::size_t>(sheet[static_cast<std::size_t>(source)])].globe;
  std::int64_t column = x - shift_x;
  if (globe > 0) {
    column -= floor_div(column, globe) * globe;
    if (column >= catalogue.rasters()[static_cast<std::size_t>(source)].width) column -= globe;
  }
  return {static_cast<int>(column), static_cast<int>(y - shift_y)};
}

constexpr double kNotOnPlane =
    -1e8;  // PlanePosts::locate() returns smaller coordinates for a position that its plane does not show

SheetPosts::SheetPosts(const LayerSheet& sheet, const LayerGroup& group)
    : sheet_(sheet), group_(group), posts_around_(posts_around(sheet.reference->grid)) {
  if (const auto* g = std::get_if<PlaneGrid>(&sheet.reference->grid))
    plane_.emplace(*g, sheet.reference->width, sheet.reference->height);
}

// Locates a position on the infinite grid of the sheet: it may lie outside all files.
PostXY SheetPosts::locate(const Geographic& position) const {
  PostXY p;
  if (plane_) {
    p = plane_->locate(position.lat_deg, position.lon_deg);
    if (std::get<PlaneGrid>(sheet_.reference->grid).plane.projection == MapProjection::orthographic &&
        p.x < kNotOnPlane)
      return locate_behind_limb(position);
  } else {
    const auto& g = std::get<GeographicGrid>(sheet_.reference->grid);
    p = {(position.lon_deg - g.first_lon_deg) * g.lon_posts_per_degree,
         (g.first_lat_deg - position.lat_deg) * g.lat_posts_per_degree};
  }
  if (posts_around_ > 0) {
    const double middle = static_cast<double>(group_.x0 + group_.x1) / 2;
    p.x -= posts_around_ * std::round((p.x - middle) / posts_around_);
  }
  return p;
}

// Locates the mirror image in front of the limb, then reflects it outward in the limb's circle.
PostXY SheetPosts::locate_behind_limb(const Geographic& position) const {
  const auto& g = std::get<PlaneGrid>(sheet_.reference->grid);
  const PostXY middle{-g.first_x_m / g.spacing_m, g.first_y_m / g.spacing_m};
  const Vec3 axis = to_cartesian(plane_->position(middle.x, middle.y)).normalized();
  const Vec3 behind = to_cartesian(position).normalized();
  const PostXY mirrored = plane_->locate(Vec3(behind - 2 * behind.dot(axis) * axis));
  const double radius_posts = kMoonRadius_m * g.plane.scale / g.spacing_m;
  const double distance_posts = std::hypot(mirrored.x - middle.x, mirrored.y - middle.y);
  // Give up far behind the limb, where the reflection would be stretched without bound.
  if (distance_posts < radius_posts / 2) return {kNotOnPlane, kNotOnPlane};
  const double outward = (2 * radius_posts - distance_posts) / distance_posts;
  return {middle.x + outward * (mirrored.x - middle.x), middle.y + outward * (mirrored.y - middle.y)};
}

double SheetPosts::distance_from_box(const PostXY& p) const {
  const auto outside = [](double v, std::int64_t from, std::int64_t to) {
    return std::max({0.0, static_cast<double>(from) - v, v - static_cast<double>(to - 1)});
  };
  return std::hypot(kMinColumnScale * outside(p.x, group_.x0, group_.x1), outside(p.y, group_.y0, group_.y1));
}

// Divides by the smallest scale in the file: towards an orthographic limb posts get wider on the ground, and towards a
// pole wider in degrees of longitude.
double widest_post_deg(const RasterInfo& info) {
  if (const auto* g = std::get_if<GeographicGrid>(&info.grid))
    return 1 / std::min(g->lat_posts_per_degree, g->lon_posts_per_degree);
  const auto& g = std::get<PlaneGrid>(info.grid);
  const Footprint& f = info.footprint;
  // Start with the spacing at the origin, which is the widest except towards the limb of an orthographic plane.
  double per_degree = kMetresPerDegree * g.plane.scale / g.spacing_m;
  if (g.plane.projection == MapProjection::orthographic) {
    const double x_m = std::max(std::abs(g.first_x_m), std::abs(g.first_x_m + (info.width - 1) * g.spacing_m)),
                 y_m = std::max(std::abs(g.first_y_m), std::abs(g.first_y_m - (info.height - 1) * g.spacing_m));
    const double from_axis = std::hypot(x_m, y_m) / kMoonRadius_m;
    per_degree *= std::sqrt(std::max(kMinColumnScale * kMinColumnScale, 1 - from_axis * from_axis));
  }
  if (f.east_deg - f.west_deg >= 360) return 1 / per_degree;
  const double farthest_lat_deg = std::max(-f.south_deg, f.north_deg);
  return 1 / (per_degree * std::max(kMinColumnScale, std::cos(farthest_lat_deg * kRadiansPerDegree)));
}

LayerGroups find_groups(const Catalogue& catalogue) {
  LayerGroups result;
  const std::size_t n = catalogue.rasters().size();
  result.sheet.assign(n, -1);
  result.group.assign(n, -1);
  result.shift.resize(n);
  find_sheets(catalogue, result);
  gather_groups(catalogue.rasters(), find_touching(catalogue, result), result);
  set_bands(catalogue, result);
  return result;
}

}  // namespace selenograph::dem
