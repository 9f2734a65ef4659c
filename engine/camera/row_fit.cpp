#include "engine/camera/row_fit.h"

#include <algorithm>
#include <cmath>

namespace selenograph::engine {
namespace {

// Returns the matrix from (point - origin, 1) to camera axes.
RowFit::Axes axes_of(const View& view, const Vec3& origin) {
  const Mat3 camera_from_moon = view.moon_from_camera().transpose();
  return {camera_from_moon, camera_from_moon * (origin - view.position())};
}

// Returns the distance in the image between the position (x, row) and that of its point in a fit around `origin`.
double error_at(const View& view, const RowFit& fit, const Vec3& origin, int row, double x, double distance_m) {
  const Camera& camera = view.camera();
  const Vec3 ray((x - camera.cx) / camera.fx, (row - camera.cy) / camera.fy, 1);
  const Vec3 from_origin = view.position() - origin + distance_m * (view.moon_from_camera() * ray);
  const Vec3 p = fit.at(row - fit.middle_row) * from_origin;
  return std::hypot(p.x() / p.z() * camera.fx + camera.cx - x, p.y() / p.z() * camera.fy + camera.cy - row);
}

}  // namespace

// Newton's divided differences through the rows above, in and below the middle.
RowFit::RowFit(const RowViews& views, int row, const Vec3& origin)
    : middle_row(std::clamp(row, 1, views.height() - 2)) {
  const int above = std::max(middle_row - kReach, 0), below = std::min(middle_row + kReach, views.height() - 1);
  const double rows_up = above - middle_row, rows_down = below - middle_row;
  coefficients[0] = axes_of(views.of(middle_row), origin);
  const Axes slope_up = (axes_of(views.of(above), origin) - coefficients[0]) / rows_up;
  const Axes slope_down = (axes_of(views.of(below), origin) - coefficients[0]) / rows_down;
  coefficients[2] = (slope_down - slope_up) / (rows_down - rows_up);
  coefficients[1] = slope_up - rows_up * coefficients[2];
}

double stretched_focal_px(const View& view) {
  const Camera& camera = view.camera();
  return camera.rectilinear() ? std::max(camera.fx, camera.fy) : view.pixels_per_metre_from(1);
}

double max_fit_error_px(const RowViews& views, double nearest_m) {
  constexpr int kRowStep = 4;
  constexpr double kFar = 100;  // times nearest_m: nothing but rotation moves the image of points that far away
  double max_error_px = 0;
  const int height = views.height();
  const double right = views.camera().width - 1;
  for (int band = 0; band * kRowsOfBand < height; ++band) {
    const int first = std::max(band * kRowsOfBand - kBandMargin, 0);
    const int last = std::min((band + 1) * kRowsOfBand + kBandMargin, height) - 1;
    const int middle = middle_of_band(band, height);
    const Vec3& origin = views.of(middle).position();
    const RowFit fit(views, middle, origin);
    for (int row = first; row <= last; row = row == last ? last + 1 : std::min(row + kRowStep, last))
      for (const double x : {0.0, right})
        for (const double distance_m : {nearest_m, kFar * nearest_m})
          max_error_px = std::max(max_error_px, error_at(views.of(row), fit, origin, row, x, distance_m));
  }
  return max_error_px;
}

}  // namespace selenograph::engine
