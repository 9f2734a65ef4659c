#include "dem/posts/layer_groups.h"

#include <numeric>

namespace selenograph::dem {
namespace {

// Posts of a row around the globe; 0: rows do not run around it.
double posts_around(const PostGrid& grid) {
  if (const auto* g = std::get_if<GeographicGrid>(&grid)) return 360 * g->lon_posts_per_degree;
  const auto& g = std::get<PlaneGrid>(grid);
  if (g.plane.projection != MapProjection::mercator) return 0;
  return 360 * kMetresPerDegree * g.plane.scale / g.spacing_m;
}

void find_sheets(const Catalogue& catalogue, LayerGroups& found) {
  const std::vector<RasterInfo>& rasters = catalogue.rasters();
  const std::size_t n = rasters.size();
  for (std::size_t i = 0; i < n; ++i) {
    const int begin = catalogue.layer_begin(static_cast<int>(i));
    if (begin == 0) continue;
    std::optional<std::pair<std::int64_t, std::int64_t>> shift;
    std::size_t s = found.sheets.size();
    while (s > 0 && found.sheets[s - 1].layer_begin == begin && !(shift = found.sheets[s - 1].shift_of(rasters[i])))
      --s;
    if (!shift) {
      LayerSheet sheet{&rasters[i], begin, 0, {}};
      const double around = posts_around(rasters[i].grid);
      if (std::abs(around - std::round(around)) < 1e-6) sheet.globe = std::llround(around);
      found.sheets.push_back(std::move(sheet));
      s = found.sheets.size();
      shift = {0, 0};
    }
    found.sheets[s - 1].sources.push_back(static_cast<int>(i));
    found.sheet[i] = static_cast<int>(s) - 1, found.shift[i] = *shift;
  }
}

// Of each file the first one of those that it touches, and that these touch.
std::vector<int> find_touching(const Catalogue& catalogue, const LayerGroups& found) {
  const std::vector<RasterInfo>& rasters = catalogue.rasters();
  const std::size_t n = rasters.size();
  std::vector<int> root(n);
  std::iota(root.begin(), root.end(), 0);
  const auto root_of = [&](int i) {
    while (root[static_cast<std::size_t>(i)] != i)
      i = root[static_cast<std::size_t>(i)] = root[static_cast<std::size_t>(root[static_cast<std::size_t>(i)])];
    return i;
  };
  for (std::size_t i = 0; i < n; ++i) {
    if (found.sheet[i] < 0) continue;
    const Footprint& f = rasters[i].footprint;
    for (const int other :
         catalogue.touching(f.south_deg, f.north_deg, f.west_deg, f.east_deg, 2 * widest_post_deg(rasters[i]))) {
      if (found.sheet[static_cast<std::size_t>(other)] != found.sheet[i]) continue;
      const int a = root_of(static_cast<int>(i)), b = root_of(other);
      root[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
    }
  }
  for (std::size_t i = 0; i < n; ++i) root[i] = root_of(static_cast<int>(i));
  return root;
}

void gather(const std::vector<RasterInfo>& rasters, const std::vector<int>& first_of, LayerGroups& found) {
  for (std::size_t i = 0; i < rasters.size(); ++i) {
    if (found.sheet[i] < 0) continue;
    const auto first = static_cast<std::size_t>(first_of[i]);
    const auto [x, y] = found.shift[i];
    const RasterInfo& info = rasters[i];
    if (first == i) {
      found.group[i] = static_cast<int>(found.groups.size());
      auto group = std::make_unique<LayerGroup>();
      group->sheet = found.sheet[i];
      group->x0 = x, group->y0 = y, group->x1 = x + info.width, group->y1 = y + info.height;
      found.groups.push_back(std::move(group));
    }
    found.group[i] = found.group[first];
    LayerGroup& group = *found.groups[static_cast<std::size_t>(found.group[i])];
    group.sources.push_back(static_cast<int>(i));
    group.x0 = std::min(group.x0, x), group.x1 = std::max(group.x1, x + info.width);
    group.y0 = std::min(group.y0, y), group.y1 = std::max(group.y1, y + info.height);
  }
}

}  // namespace

double widest_post_deg(const RasterInfo& info) {
  if (const auto* g = std::get_if<GeographicGrid>(&info.grid))
    return 1 / std::min(g->lat_posts_per_degree, g->lon_posts_per_degree);
  const auto& g = std::get<PlaneGrid>(info.grid);
  const Footprint& f = info.footprint;
  // Posts lie farthest apart at the origin, but towards the limb of an orthographic plane.
  double per_degree = kMetresPerDegree * g.plane.scale / g.spacing_m;
  if (g.plane.projection == MapProjection::orthographic) {
    const double x_m = std::max(std::abs(g.first_x_m), std::abs(g.first_x_m + (info.width - 1) * g.spacing_m)),
                 y_m = std::max(std::abs(g.first_y_m), std::abs(g.first_y_m - (info.height - 1) * g.spacing_m));
    const double from_axis = std::hypot(x_m, y_m) / kMoonRadius_m;
    per_degree *= std::sqrt(std::max(kLeastScale * kLeastScale, 1 - from_axis * from_axis));
  }
  if (f.east_deg - f.west_deg >= 360) return 1 / per_degree;
  const double farthest_lat_deg = std::max(-f.south_deg, f.north_deg);
  return 1 / (per_degree * std::max(kLeastScale, std::cos(farthest_lat_deg * kRadiansPerDegree)));
}

std::optional<std::pair<std::int64_t, std::int64_t>> LayerSheet::shift_of(const RasterInfo& info) const {
  constexpr double kTolerance = 1e-3;  // of a post
  double dx = 0, dy = 0;
  if (info.grid.index() != reference->grid.index()) return std::nullopt;
  if (const auto* a = std::get_if<PlaneGrid>(&reference->grid)) {
    const auto& b = std::get<PlaneGrid>(info.grid);
    if (a->plane != b.plane || std::abs(a->spacing_m / b.spacing_m - 1) > 1e-9) return std::nullopt;
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

LayerGroups find_groups(const Catalogue& catalogue) {
  LayerGroups found;
  const std::size_t n = catalogue.rasters().size();
  found.sheet.assign(n, -1), found.group.assign(n, -1), found.shift.resize(n);
  find_sheets(catalogue, found);
  gather(catalogue.rasters(), find_touching(catalogue, found), found);
  return found;
}

}  // namespace selenograph::dem
