// The files of finer layers by what joins them: those on one grid are a sheet, those of a sheet that touch are a group.
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
#include "dem/support/once.h"

namespace selenograph::dem {

// How far a file's posts are apart, in degrees of latitude or of longitude, whichever is more. Of a file that is true
// to scale at a high latitude that is longitude.
double widest_post_deg(const RasterInfo& info);

inline constexpr double kLeastScale = 1.0 / 8;  // of longitudes: beyond 83 degrees bands narrow towards the poles

// A grid that the posts of some files of a layer lie on; its post (0, 0) is the first of the first file.
struct LayerSheet {
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
  // Where a file's first post lies; nothing: not on this grid.
  std::optional<std::pair<std::int64_t, std::int64_t>> shift_of(const RasterInfo& info) const;
};

// Files of a sheet that touch each other.
struct LayerGroup {
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

struct LayerGroups {
  std::vector<LayerSheet> sheets;
  std::vector<std::unique_ptr<LayerGroup>> groups;
  // By source; -1: of the coarsest layer.
  std::vector<int> sheet, group;
  std::vector<std::pair<std::int64_t, std::int64_t>> shift;
};

// Of all files but those of the coarsest layer.
LayerGroups find_groups(const Catalogue& catalogue);

}  // namespace selenograph::dem
