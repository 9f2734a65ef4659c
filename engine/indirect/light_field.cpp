#include "engine/indirect/light_field.h"

#include <algorithm>
#include <cmath>

#include "dem/grid/lattice.h"
#include "engine/relief/relief.h"

namespace selenograph::engine {
namespace {

// Returns the height of a band of latitude: 256 posts of light, which are 2^-level degrees apart.
double band_height_deg(const LightField& field) {
  constexpr int kPostsPerBand = 256;
  return kPostsPerBand / std::exp2(field.level);
}

struct CellBounds {
  double south_deg, north_deg, west_deg, width_deg;
};

// Returns the number of cells of a band, each about as wide as high in the band's middle.
int cells_of_band(double south_deg, double height_deg) {
  const double middle_deg = std::min(south_deg + height_deg / 2, 90.0);
  return std::max(1, static_cast<int>(std::ceil(360 * std::cos(middle_deg * kRadiansPerDegree) / height_deg)));
}

// Returns the bounds of a field's cell. The field itself extends beyond it.
CellBounds cell_of(const LightField& field) {
  const double height_deg = band_height_deg(field), south_deg = -90 + field.band * height_deg;
  const double width_deg = 360.0 / cells_of_band(south_deg, height_deg);
  return {south_deg, std::min(south_deg + height_deg, 90.0), -180 + field.cell * width_deg, width_deg};
}

}  // namespace

LightField light_field_at(int level, int finest, bool closer, double lat_deg, double lon_deg) {
  LightField field{level, finest, closer, 0, 0};
  const double height_deg = band_height_deg(field);
  const int bands = static_cast<int>(std::ceil(180 / height_deg));
  field.band = std::clamp(static_cast<int>((lat_deg + 90) / height_deg), 0, bands - 1);
  const int cells = cells_of_band(-90 + field.band * height_deg, height_deg);
  field.cell = std::clamp(static_cast<int>((lon_deg + 180) / 360 * cells), 0, cells - 1);
  return field;
}

FieldPlane::FieldPlane(const LightField& field) : spacing_m_(dem::post_spacing_m(field.level)) {
  const CellBounds cell = cell_of(field);
  const double middle_lat_deg = (cell.south_deg + cell.north_deg) / 2,
               middle_lon_deg = cell.west_deg + cell.width_deg / 2;
  centre_ = to_cartesian({middle_lat_deg, middle_lon_deg, 0}).normalized();
  axes_ = relief_axes(centre_);
  // Half the side of a square of the plane that contains the cell's corners and the middles of its edges.
  double half_m = 0;
  for (const double lat_deg : {cell.south_deg, middle_lat_deg, cell.north_deg})
    for (const double lon_deg : {cell.west_deg, middle_lon_deg, cell.west_deg + cell.width_deg}) {
      const Vec3 d = axes_ * to_cartesian({lat_deg, lon_deg, 0}).normalized();
      half_m = std::max({half_m, kMoonRadius_m * std::abs(d.x() / d.z()), kMoonRadius_m * std::abs(d.y() / d.z())});
    }
  // kBlockReach: half the diagonal of a block of 64 x 64 quads, in posts. kBend: meridians and parallels are bent in
  // the plane between these points.
  constexpr double kBlockReach = 48, kBend = 1.02;
  const double reach = field.closer ? kBlockReach * (1 << kCloser) : kBlockReach;
  tiles_ = 2 * static_cast<int>(std::ceil((kBend * half_m / spacing_m_ + reach) / kTileQuads));
  const double posts_per_slope = kMoonRadius_m / spacing_m_;
  posts_ = {axes_.row(0) * posts_per_slope, axes_.row(1) * posts_per_slope, axes_.row(2)};
}

FieldPost FieldPlane::post_at(const Vec3& position_m) const {
  const Vec2 position = posts_from_south_west(position_m);
  const int quads = tiles_ * kTileQuads;
  const auto first_post = [&](double posts) {
    return std::min(static_cast<int>(std::clamp(posts, 0.0, double(quads))), quads - 1);
  };
  const int column = first_post(position.x()), row = first_post(position.y());
  return {row / kTileQuads * tiles_ + column / kTileQuads, row % kTileQuads, column % kTileQuads,
          std::clamp(position.x() - column, 0.0, 1.0), std::clamp(position.y() - row, 0.0, 1.0)};
}

Vec3 FieldPlane::position_m(int column, int row) const {
  return axes_.transpose_times({(column - middle()) * spacing_m_, (row - middle()) * spacing_m_, kMoonRadius_m});
}

}  // namespace selenograph::engine
