// Groups the files of finer layers: files on one grid form a sheet, touching files of a sheet form a group.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>
#include <variant>
#include <vector>

#include "dem/catalogue/catalogue.h"
#include "dem/grid/geodesy.h"

namespace selenograph::dem {

inline constexpr double kLeastScale = 1.0 / 8;  // of longitudes: beyond 83 degrees bands narrow towards the poles

// Spacing of a file's posts in degrees of latitude or longitude, whichever is larger. For a file that is true to scale
// at a high latitude that is longitude. At most 1 / kLeastScale times as far apart as at the equator, or as at the
// origin of an orthographic projection.
double widest_post_deg(const RasterInfo& info);

// A grid common to some files of a layer; its post (0, 0) is the first post of the first file.
struct LayerSheet {
  const RasterInfo* reference = nullptr;
  int layer_begin = 0;
  std::int64_t globe = 0;  // posts around the globe, where they are a whole number; else 0
  std::vector<int> sources;

  bool on_plane() const { return std::holds_alternative<PlaneGrid>(reference->grid); }
  // Not wrapped: there is nothing at latitudes beyond a pole.
  Geographic place(double x, double y) const {
    if (const auto* g = std::get_if<PlaneGrid>(&reference->grid))
      return PlanePosts(*g, reference->width, reference->height).position(x, y);
    const auto& g = std::get<GeographicGrid>(reference->grid);
    return {g.first_lat_deg - y / g.lat_posts_per_degree, g.first_lon_deg + x / g.lon_posts_per_degree, 0};
  }
  // Ratio of a column's spacing to a row's, on the ground.
  double column_scale(double y) const {
    const auto* g = std::get_if<GeographicGrid>(&reference->grid);
    if (!g) return 1;
    const double lat = g->first_lat_deg - y / g->lat_posts_per_degree;
    return std::max(kLeastScale, std::cos(lat * kRadiansPerDegree) * g->lat_posts_per_degree / g->lon_posts_per_degree);
  }
  bool is_beyond_pole(std::int64_t y) const {
    const auto* g = std::get_if<GeographicGrid>(&reference->grid);
    return g && std::abs(g->first_lat_deg - static_cast<double>(y) / g->lat_posts_per_degree) > 90;
  }
  // The largest octave up to this one whose cells are the same from either side of the globe.
  int octave_up_to(int octave) const {
    while (globe % (std::int64_t{1} << octave) != 0) --octave;
    return octave;
  }
};

// Files of a sheet that touch each other.
struct LayerGroup {
  int sheet = 0;
  std::vector<int> sources;
  std::int64_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // in posts of the sheet
  int layer_begin = 0;
  int beneath = -1;  // finest coarser file below it; -1: none
  double post_spacing_m = 0;
  double spacing_ratio = 1;  // post spacing of `beneath` over its own
  double band_posts = 0;     // width of the band outside it in which coarser layers are bent; 0: none
  int octave = 0;            // coarsest octave of the band (layer_bends.h)
  double band_cells = 1;     // width of the band in cells of that octave, less a margin
};

struct LayerGroups {
  std::vector<LayerSheet> sheets;
  std::vector<std::unique_ptr<LayerGroup>> groups;
  // Indices by source; -1: in the coarsest layer.
  std::vector<int> sheet, group;
  std::vector<std::pair<std::int64_t, std::int64_t>> shift;
  double widest_band_deg = 0;  // of any group, degrees of latitude

  // Column and row of a file's post at a post of its sheet.
  std::pair<int, int> post_in_file(const Catalogue& catalogue, int source, std::int64_t x, std::int64_t y) const;
};

// Places in posts of a group's sheet, on the turn around the globe that is nearest to the group. An orthographic plane
// goes on beyond its limb: a place as far behind the limb as another is before it is as far outside as that is inside.
class SheetPosts {
 public:
  SheetPosts(const LayerSheet& sheet, const LayerGroup& group);
  PostXY locate(const Geographic& place) const;
  // Distance of a place from the box of the group's posts, in rows; at most the true one.
  double away_from_box(const PostXY& p) const;

 private:
  const LayerSheet& sheet_;
  const LayerGroup& group_;
  PostXY beyond_limb(const Geographic& place) const;
  double posts_around_;  // 0: rows do not run around the globe
  std::optional<PlanePosts> plane_;
};

// Groups of all files except those of the coarsest layer.
LayerGroups find_groups(const Catalogue& catalogue);

}  // namespace selenograph::dem
