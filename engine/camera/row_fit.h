// Projection by the views of neighbouring rows, as polynomials of the row: what the z-buffer needs to find, for each
// vertex, the row that images it.
#pragma once

#include <Eigen/Core>
#include <array>

#include "engine/camera/row_views.h"

namespace selenograph::engine {

// The poses around a middle row. A point's camera axes in the row r below the middle one are
//   (coefficients[0] + r coefficients[1] + r^2 coefficients[2]) (point - origin, 1).
struct RowFit {
  using Axes = Eigen::Matrix<double, 3, 4>;

  // Fits the views of three rows that are up to kReach rows apart. The frame has at least three rows.
  RowFit(const RowViews& views, int row, const Vec3& origin);

  static constexpr int kReach = 48;  // rows from the middle one at which the fit is exact

  int middle_row;
  std::array<Axes, 3> coefficients;

  Axes at(double rows_below_middle) const {
    return coefficients[0] + rows_below_middle * (coefficients[1] + rows_below_middle * coefficients[2]);
  }
};

// Rows of the bands that a frame is divided into, each with its own fit; and rows above and below a band up to which
// its fit is used.
inline constexpr int kRowsOfBand = 64, kBandMargin = 48;
// Returns the middle row of a band.
inline int middle_of_band(int band, int height) {
  const int first = band * kRowsOfBand;
  return first + (height - first < kRowsOfBand ? height - first : kRowsOfBand) / 2;
}

// Returns an upper bound of the pixels, through the lens or without it, per unit of slope x / z or y / z.
double stretched_focal_px(const View& view);

// Returns the largest deviation of the bands' fits from the views of the rows, in pixels: at both ends of the rows, for
// points at `nearest_m` from the camera and farther.
double max_fit_error_px(const RowViews& views, double nearest_m);

}  // namespace selenograph::engine
