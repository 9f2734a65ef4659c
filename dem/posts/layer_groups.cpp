#include "dem/posts/layer_groups.h"

#include <numeric>

namespace selenograph::dem {
namespace {

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
      if (const auto* g = std::get_if<GeographicGrid>(&rasters[i].grid)) {
        const double around = 360 * g->lon_posts_per_degree;
        if (std::abs(around - std::round(around)) < 1e-6) sheet.globe = std::llround(around);
      }
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
  const auto* grid = std::get_if<GeographicGrid>(&info.grid);
  return 1 / (grid ? std::min(grid->lat_posts_per_degree, grid->lon_posts_per_degree) : info.posts_per_degree);
}

std::optional<std::pair<std::int64_t, std::int64_t>> LayerSheet::shift_of(const RasterInfo& info) const {
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

LayerGroups find_groups(const Catalogue& catalogue) {
  LayerGroups found;
  const std::size_t n = catalogue.rasters().size();
  found.sheet.assign(n, -1), found.group.assign(n, -1), found.shift.resize(n);
  find_sheets(catalogue, found);
  gather(catalogue.rasters(), find_touching(catalogue, found), found);
  return found;
}

}  // namespace selenograph::dem
