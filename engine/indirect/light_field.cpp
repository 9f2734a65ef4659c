#include "engine/indirect/light_field.h"

#include <algorithm>
#include <cmath>

#include "dem/grid/lattice.h"
#include "engine/indirect/relief.h"

namespace selenograph::engine {
namespace {

double height_deg(const LightField& field) {
  constexpr int kPosts = 256;
  return kPosts / std::exp2(field.level);
}

struct CellBounds {
  double south_deg, north_deg, west_deg, width_deg;
};

// Returns the number of cells of a band, each about as wide as high in the band's middle.
int cells_of_band(double south_deg, double height) {
  const double middle = std::min(south_deg + height / 2, 90.0);
  return std::max(1, static_cast<int>(std::ceil(360 * std::cos(middle * kRadiansPerDegree) / height)));
}

CellBounds bounds_of(const LightField& field) {
  const double height = height_deg(field), south = -90 + field.band * height;
  const double width = 360.0 / cells_of_band(south, height);
  return {south, std::min(south + height, 90.0), -180 + field.cell * width, width};
}

}  // namespace

LightField light_field_at(int level, int finest, bool closer, double lat_deg, double lon_deg) {
  LightField field{level, finest, closer, 0, 0};
  const double height = height_deg(field);
  const int bands = static_cast<int>(std::ceil(180 / height));
  field.band = std::clamp(static_cast<int>((lat_deg + 90) / height), 0, bands - 1);
  const int cells = cells_of_band(-90 + field.band * height, height);
  field.cell = std::clamp(static_cast<int>((lon_deg + 180) / 360 * cells), 0, cells - 1);
  return field;
}

FieldPlane::FieldPlane(const LightField& field) : spacing_m_(dem::post_spacing_m(field.level)) {
  const CellBounds cell = bounds_of(field);
  const double lat = (cell.south_deg + cell.north_deg) / 2, lon = cell.west_deg + cell.width_deg / 2;
  centre_ = to_cartesian({lat, lon, 0}).normalized();
  axes_ = relief_axes(centre_);
  double half_m = 0;
  for (const double to_lat : {cell.south_deg, lat, cell.north_deg})
    for (const double to_lon : {cell.west_deg, lon, cell.west_deg + cell.width_deg}) {
      const Vec3 d = axes_ * to_cartesian({to_lat, to_lon, 0}).normalized();
      half_m = std::max({half_m, kMoonRadius_m * std::abs(d.x() / d.z()), kMoonRadius_m * std::abs(d.y() / d.z())});
    }
  // Half the diagonal of a block, posts; bending of meridians and parallels in the plane.
  constexpr double kReach = 48, kBend = 1.02;
  const double reach = field.closer ? kReach * (1 << kCloser) : kReach;
  tiles_ = 2 * static_cast<int>(std::ceil((kBend * half_m / spacing_m_ + reach) / kTileQuads));
  posts_ = axes_;
  posts_.topRows<2>() *= kMoonRadius_m / spacing_m_;
}

FieldPost FieldPlane::post_at(const Vec3& position_m) const {
  const Eigen::Vector2d position = posts_from_south_west(position_m);
  const int last = tiles_ * kTileQuads;
  const auto split = [&](double posts) {
    return std::min(static_cast<int>(std::clamp(posts, 0.0, double(last))), last - 1);
  };
  const int column = split(position.x()), row = split(position.y());
  return {row / kTileQuads * tiles_ + column / kTileQuads, row % kTileQuads, column % kTileQuads,
          std::clamp(position.x() - column, 0.0, 1.0), std::clamp(position.y() - row, 0.0, 1.0)};
}

Vec3 FieldPlane::position_m(int column, int row) const {
  return axes_.transpose() * Vec3((column - middle()) * spacing_m_, (row - middle()) * spacing_m_, kMoonRadius_m);
}

}  // namespace selenograph::engine
