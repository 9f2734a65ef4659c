#include "dem/gdal/warp_rectangle.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "dem/grid/geodesy.h"

namespace selenograph::dem {
namespace {

// From places in a raster, in pixels from its outer corner, to places on the sphere, and back.
class RasterPlaces {
 public:
  RasterPlaces(GDALDataset& raster, const OGRSpatialReference& srs, const OGRSpatialReference& degrees)
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

  std::optional<Geographic> place(double column, double row) const {
    double x = pixel_[0] + column * pixel_[1] + row * pixel_[2], y = pixel_[3] + column * pixel_[4] + row * pixel_[5];
    if (!to_degrees_->Transform(1, &x, &y) || !std::isfinite(x) || !std::isfinite(y)) return std::nullopt;
    return Geographic{y, x};
  }

  // Returns whether a pole is a point, where all meridians meet, of the raster or of its border.
  bool holds_pole(double lat_deg) const {
    constexpr double kBorder_px = 0.5;
    const auto at = pixel(lat_deg, 0), opposite = pixel(lat_deg, 180);
    if (!at || !opposite || std::hypot((*at)[0] - (*opposite)[0], (*at)[1] - (*opposite)[1]) > kBorder_px) return false;
    const auto [column, row] = *at;
    return column > -kBorder_px && column < width_ + kBorder_px && row > -kBorder_px && row < height_ + kBorder_px;
  }

  // Of the smallest pixel among those in the corners and the middle, as an angle.
  double pixel_deg() const {
    double least_m = kMoonRadius_m;
    for (const auto& [x, y] : {std::array{0.0, 0.0},
                               {width_ - 1, 0},
                               {0, height_ - 1},
                               {width_ - 1, height_ - 1},
                               {width_ / 2, height_ / 2}})
      if (const auto a = place(x, y), b = place(x + 1, y + 1); a && b)
        least_m = std::min(least_m, (to_cartesian(*a) - to_cartesian(*b)).norm() / std::sqrt(2.0));
    return least_m / kMetresPerDegree;
  }

 private:
  using Transformation = std::unique_ptr<OGRCoordinateTransformation>;

  // Column and row of a place; empty: the plane does not show it.
  std::optional<std::array<double, 2>> pixel(double lat_deg, double lon_deg) const {
    double x = lon_deg, y = lat_deg;
    if (!from_degrees_->Transform(1, &x, &y) || !std::isfinite(x) || !std::isfinite(y)) return std::nullopt;
    return std::array{inverse_[0] + x * inverse_[1] + y * inverse_[2], inverse_[3] + x * inverse_[4] + y * inverse_[5]};
  }

  double width_, height_, pixel_[6]{}, inverse_[6]{};
  Transformation to_degrees_, from_degrees_;
  bool valid_ = false;
};

// Along the border, longitude without jumps. Empty: part of the border is nowhere.
std::optional<WarpRectangle> around(const RasterPlaces& places) {
  constexpr int kSide = 64;
  const double w = places.width(), h = places.height();
  const auto first = places.place(0, 0);
  if (!first) return std::nullopt;
  double lon_deg = first->lon_deg;
  WarpRectangle r{lon_deg, first->lat_deg, lon_deg, first->lat_deg, 0, 0};
  for (int i = 1; i < 4 * kSide; ++i) {
    const double along = static_cast<double>(i % kSide) / kSide;
    const std::array<std::array<double, 2>, 4> sides{
        {{along * w, 0}, {w, along * h}, {(1 - along) * w, h}, {0, (1 - along) * h}}};
    const auto& [column, row] = sides[static_cast<std::size_t>(i / kSide)];
    const auto place = places.place(column, row);
    if (!place) return std::nullopt;
    lon_deg += std::remainder(place->lon_deg - lon_deg, 360);
    r.west_deg = std::min(r.west_deg, lon_deg), r.east_deg = std::max(r.east_deg, lon_deg);
    r.south_deg = std::min(r.south_deg, place->lat_deg), r.north_deg = std::max(r.north_deg, place->lat_deg);
  }
  return r;
}

// Bounds a raster that reaches beyond the limb of its projection: by places on a mesh over it, and by a margin that is
// wider than the gap between the limb and the outermost of them. Empty: all of the raster is nowhere.
std::optional<WarpRectangle> within_limb(const RasterPlaces& places) {
  constexpr int kSide = 64;
  constexpr double kMargin_deg = 20;  // acos(1 - 2 / kSide) is 14 degrees
  std::vector<double> lats_deg, lons_deg;
  for (int i = 0; i <= kSide; ++i)
    for (int j = 0; j <= kSide; ++j)
      if (const auto place = places.place(places.width() * i / kSide, places.height() * j / kSide)) {
        lats_deg.push_back(place->lat_deg);
        lons_deg.push_back(place->lon_deg);
      }
  if (lons_deg.empty()) return std::nullopt;
  const auto [south, north] = std::minmax_element(lats_deg.begin(), lats_deg.end());
  // The raster lies outside of the widest gap between the meridians of those places.
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
  const RasterPlaces places(raster, srs, degrees);
  if (!places.valid()) return std::nullopt;
  std::optional<WarpRectangle> r = around(places);
  const bool beyond_limb = !r;
  if (beyond_limb) r = within_limb(places);
  if (!r) return std::nullopt;
  const double step_deg = places.pixel_deg();
  const bool north = places.holds_pole(90), south = places.holds_pole(-90);
  const auto turns = [](double lon_deg) { return std::floor((lon_deg + 180) / 360); };
  const bool crosses = turns(r->west_deg + step_deg) != turns(r->east_deg - step_deg);
  if (!north && !south && !crosses && !beyond_limb) return std::nullopt;
  if (north) r->north_deg = 90;
  if (south) r->south_deg = -90;
  if (north || south || r->east_deg - r->west_deg > 360) r->west_deg = -180, r->east_deg = 180;
  const double nearest_deg = std::max({0.0, r->south_deg, -r->north_deg});  // to the equator
  r->width =
      static_cast<int>(std::ceil((r->east_deg - r->west_deg) * std::cos(nearest_deg * kRadiansPerDegree) / step_deg));
  r->height = static_cast<int>(std::ceil((r->north_deg - r->south_deg) / step_deg));
  return r;
}

}  // namespace selenograph::dem
