// Groups the files of finer layers: files on one grid form a sheet, touching files of a sheet form a group.
//
//     sheet: one lattice of posts    +-----+-----+        +-----+
//     for all files of its layer     |  a  |  b  |        |  d  |     groups: {a, b, c} and {d}
//     on that grid                   +-----+-----+        +-----+
//                                    |  c  |
//                                    +-----+
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

inline constexpr double kMinColumnScale =
    1.0 / 8;  // minimum of a column's width over a row's: poleward of 83 degrees bands narrow towards the poles

// Returns the spacing of a file's posts in degrees of latitude or longitude, whichever is larger. For a file that is
// true to scale at a high latitude that is longitude. The result is at most 1 / kMinColumnScale times the spacing at
// the equator, or at the origin of an orthographic projection.
double widest_post_deg(const RasterInfo& info);

// Grid common to several files of a layer; its post (0, 0) is the first post of the first file, `reference`.
struct LayerSheet {
  const RasterInfo* reference = nullptr;
  int layer_begin = 0;     // first file of the layer
  std::int64_t globe = 0;  // posts per turn around the globe if that is a whole number; else 0
  std::vector<int> sources;

  bool on_plane() const { return std::holds_alternative<PlaneGrid>(reference->grid); }
  // Returns the geographic position of a column and row. The latitude is not wrapped: rows beyond a pole have latitudes
  // beyond 90 degrees.
  Geographic position_at(double x, double y) const {
    if (const auto* g = std::get_if<PlaneGrid>(&reference->grid))
      return PlanePosts(*g, reference->width, reference->height).position(x, y);
    const auto& g = std::get<GeographicGrid>(reference->grid);
    return {g.first_lat_deg - y / g.lat_posts_per_degree, g.first_lon_deg + x / g.lon_posts_per_degree, 0};
  }
  // Returns the ratio of the columns' spacing to the rows', measured on the ground at row y.
  double column_scale(double y) const {
    const auto* g = std::get_if<GeographicGrid>(&reference->grid);
    if (!g) return 1;
    const double lat = g->first_lat_deg - y / g->lat_posts_per_degree;
    return std::max(kMinColumnScale,
                    std::cos(lat * kRadiansPerDegree) * g->lat_posts_per_degree / g->lon_posts_per_degree);
  }
  bool is_beyond_pole(std::int64_t y) const {
    const auto* g = std::get_if<GeographicGrid>(&reference->grid);
    return g && std::abs(g->first_lat_deg - static_cast<double>(y) / g->lat_posts_per_degree) > 90;
  }
  // Returns the largest octave up to `octave` whose cells divide a turn around the globe, so that cells are the same
  // counted eastward or westward.
  int octave_up_to(int octave) const {
    while (globe % (std::int64_t{1} << octave) != 0) --octave;
    return octave;
  }
};

// Files of a sheet that touch each other.
struct LayerGroup {
  int sheet = 0;                                // index in LayerGroups::sheets
  std::vector<int> sources;                     // files, ascending
  std::int64_t x0 = 0, y0 = 0, x1 = 0, y1 = 0;  // box in posts of the sheet; x1 and y1 are exclusive
  int layer_begin = 0;                          // first file of the group's layer
  int beneath = -1;                             // finest file of a coarser layer below the group; -1: none
  double post_spacing_m = 0;
  double spacing_ratio = 1;  // post spacing of `beneath` over the group's own
  double band_posts = 0;     // width of the band outside the group in which coarser layers are bent; 0: none
  int octave = 0;            // coarsest octave of the band's cells (layer_bends.h)
  double band_cells = 1;     // width of the band in cells of that octave, less a margin
};

struct LayerGroups {
  std::vector<LayerSheet> sheets;
  std::vector<std::unique_ptr<LayerGroup>> groups;
  // Indices of each file's sheet and group; -1 for files of the coarsest layer.
  std::vector<int> sheet, group;
  std::vector<std::pair<std::int64_t, std::int64_t>> shift;  // each file's first post, as column and row of its sheet
  double widest_band_deg = 0;                                // widest band of any group, degrees of latitude

  // Returns the column and row, in a file, of the post at (x, y) of the file's sheet.
  std::pair<int, int> post_in_file(const Catalogue& catalogue, int source, std::int64_t x, std::int64_t y) const;
};

// Converts geographic positions to posts of a group's sheet, on the turn around the globe that is nearest to the group.
// An orthographic plane is continued beyond its limb by reflection: a point behind the limb lies as far outside the
// limb's circle as its mirror image in front lies inside.
class SheetPosts {
 public:
  SheetPosts(const LayerSheet& sheet, const LayerGroup& group);
  PostXY locate(const Geographic& position) const;
  // Returns a lower bound of the distance from a position to the box of the group's posts, in rows.
  double distance_from_box(const PostXY& p) const;

 private:
  const LayerSheet& sheet_;
  const LayerGroup& group_;
  PostXY locate_behind_limb(const Geographic& position) const;
  double posts_around_;  // posts per turn around the globe; 0: rows do not run around it
  std::optional<PlanePosts> plane_;
};

// Returns the groups of all files except those of the coarsest layer.
LayerGroups find_groups(const Catalogue& catalogue);

}  // namespace selenograph::dem
