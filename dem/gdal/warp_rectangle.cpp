#include "dem/gdal/warp_rectangle.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

// Converts positions in a raster, in pixels from its outer corner, to positions on the sphere, and back.
class RasterPositions {
 public:
  RasterPositions(GDALDataset& raster, const OGRSpatialReference& srs, const OGRSpatialReference& degrees)
      : width_(raster.GetRasterXSize()),
        height_(raster.GetRasterYSize()),
        to_degrees_(OGRCreateCoordinateTransformation(&srs, &degrees)),
        from_degrees_(OGRCreateCoordinateTransformation(&degrees, &srs)) {
    valid_ = to_degrees_ && from_degrees_ && raster.GetGeoTransform(pixel_) == CE_None &&
             GDALInvGeoTransform(pixel_, inverse_);
  }

  bool valid() const { return valid_; }
  double width() const { return width_; }
  double height() const { return height_; }

  // Returns the position on the sphere of a point of the raster; empty where its plane has no point of the sphere.
  std::optional<Geographic> position(double column, double row) const {
    double x = pixel_[0] + column * pixel_[1] + row * pixel_[2], y = pixel_[3] + column * pixel_[4] + row * pixel_[5];
    if (!to_degrees_->Transform(1, &x, &y) || !std::isfinite(x) || !std::isfinite(y)) return std::nullopt;
    return Geographic{y, x};
  }

  // Returns true if a pole of the sphere is one point of the raster, where all meridians meet, or of its border.
  bool holds_pole(double lat_deg) const {
    constexpr double kBorder_px = 0.5;
    const auto pole = pixel(lat_deg, 0), opposite = pixel(lat_deg, 180);
    if (!pole || !opposite) return false;
    if (std::hypot((*pole)[0] - (*opposite)[0], (*pole)[1] - (*opposite)[1]) > kBorder_px) return false;
    const auto [column, row] = *pole;
    return column > -kBorder_px && column < width_ + kBorder_px && row > -kBorder_px && row < height_ + kBorder_px;
  }

  // Returns the side, as an angle, of the smallest pixel among those at the corners and the centre.
  double pixel_deg() const {
    double smallest_m = kMoonRadius_m;
    for (const auto& [x, y] : {std::array{0.0, 0.0},
                               {width_ - 1, 0},
                               {0, height_ - 1},
                               {width_ - 1, height_ - 1},
                               {width_ / 2, height_ / 2}})
      if (const auto a = position(x, y), b = position(x + 1, y + 1); a && b)
        smallest_m = std::min(smallest_m, (to_cartesian(*a) - to_cartesian(*b)).norm() / std::sqrt(2.0));
    return smallest_m / kMetresPerDegree;
  }

 private:
  using Transformation = std::unique_ptr<OGRCoordinateTransformation>;

  // Returns column and row of a position; empty if the plane does not show it.
  std::optional<std::array<double, 2>> pixel(double lat_deg, double lon_deg) const {
    double x = lon_deg, y = lat_deg;
    if (!from_degrees_->Transform(1, &x, &y) || !std::isfinite(x) || !std::isfinite(y)) return std::nullopt;
    return std::array{inverse_[0] + x * inverse_[1] + y * inverse_[2], inverse_[3] + x * inverse_[4] + y * inverse_[5]};
  }

  double width_, height_, pixel_[6]{}, inverse_[6]{};
  Transformation to_degrees_, from_degrees_;
  bool valid_ = false;
};

// Returns the bounds of the raster's border, followed with continuous longitude; empty if a point of the border is not
// on the sphere.
std::optional<WarpRectangle> border_bounds(const RasterPositions& positions) {
  constexpr int kSide = 64;
  const double w = positions.width(), h = positions.height();
  const auto first = positions.position(0, 0);
  if (!first) return std::nullopt;
  double lon_deg = first->lon_deg;
  WarpRectangle r{lon_deg, first->lat_deg, lon_deg, first->lat_deg, 0, 0};
  for (int i = 1; i < 4 * kSide; ++i) {
    const double fraction = static_cast<double>(i % kSide) / kSide;
    const std::array<std::array<double, 2>, 4> sides{
        {{fraction * w, 0}, {w, fraction * h}, {(1 - fraction) * w, h}, {0, (1 - fraction) * h}}};
    const auto& [column, row] = sides[static_cast<std::size_t>(i / kSide)];
    const auto position = positions.position(column, row);
    if (!position) return std::nullopt;
    lon_deg += std::remainder(position->lon_deg - lon_deg, 360);
    r.west_deg = std::min(r.west_deg, lon_deg);
    r.east_deg = std::max(r.east_deg, lon_deg);
    r.south_deg = std::min(r.south_deg, position->lat_deg);
    r.north_deg = std::max(r.north_deg, position->lat_deg);
  }
  return r;
}

// Returns bounds of a raster that reaches beyond the limb of its projection: those of a mesh of points over it, with a
// margin wider than the gap between the limb and the outermost points. Empty if no point of the mesh is on the sphere.
std::optional<WarpRectangle> bounds_within_limb(const RasterPositions& positions) {
  constexpr int kSide = 64;
  constexpr double kMargin_deg = 20;  // more than acos(1 - 2 / kSide), 14 degrees: the gap of one mesh cell at the limb
  std::vector<double> lats_deg, lons_deg;
  for (int i = 0; i <= kSide; ++i)
    for (int j = 0; j <= kSide; ++j)
      if (const auto position = positions.position(positions.width() * i / kSide, positions.height() * j / kSide)) {
        lats_deg.push_back(position->lat_deg);
        lons_deg.push_back(position->lon_deg);
      }
  if (lons_deg.empty()) return std::nullopt;
  const auto [south, north] = std::minmax_element(lats_deg.begin(), lats_deg.end());
  // Start the rectangle at the eastern end of the widest gap between the points' meridians: the raster lies outside of
  // that gap.
  std::sort(lons_deg.begin(), lons_deg.end());
  double west_deg = lons_deg.front(), gap_deg = west_deg + 360 - lons_deg.back();
  for (std::size_t i = 1; i < lons_deg.size(); ++i)
    if (lons_deg[i] - lons_deg[i - 1] > gap_deg) {
      west_deg = lons_deg[i];
      gap_deg = lons_deg[i] - lons_deg[i - 1];
    }
  return WarpRectangle{west_deg - kMargin_deg,
                       std::max(-90.0, *south - kMargin_deg),
                       west_deg + 360 - gap_deg + kMargin_deg,
                       std::min(90.0, *north + kMargin_deg),
                       0,
                       0};
}

}  // namespace

std::optional<WarpRectangle> warp_rectangle(GDALDataset& raster, const OGRSpatialReference& srs,
                                            const OGRSpatialReference& degrees) {
  const QuietGdal quiet;
  const RasterPositions positions(raster, srs, degrees);
  if (!positions.valid()) return std::nullopt;
  std::optional<WarpRectangle> r = border_bounds(positions);
  const bool beyond_limb = !r;
  if (beyond_limb) r = bounds_within_limb(positions);
  if (!r) return std::nullopt;
  const double step_deg = positions.pixel_deg();
  const bool north = positions.holds_pole(90), south = positions.holds_pole(-90);
  const auto turns = [](double lon_deg) { return std::floor((lon_deg + 180) / 360); };
  const bool crosses_date_line = turns(r->west_deg + step_deg) != turns(r->east_deg - step_deg);
  if (!north && !south && !crosses_date_line && !beyond_limb) return std::nullopt;
  if (north) r->north_deg = 90;
  if (south) r->south_deg = -90;
  if (north || south || r->east_deg - r->west_deg > 360) {
    r->west_deg = -180;
    r->east_deg = 180;
  }
  const double equatorward_deg = std::max({0.0, r->south_deg, -r->north_deg});
  r->width = static_cast<int>(
      std::ceil((r->east_deg - r->west_deg) * std::cos(equatorward_deg * kRadiansPerDegree) / step_deg));
  r->height = static_cast<int>(std::ceil((r->north_deg - r->south_deg) / step_deg));
  return r;
}

}  // namespace selenograph::dem
