// Projection by the views of neighbouring rows, as polynomials of the row: what the z-buffer needs to find, for each
// vertex, the row that images it.
#pragma once

#include <array>

#include "engine/camera/row_views.h"

namespace selenograph::engine {

// The poses around a middle row. A point's camera axes in the row r below the middle one are
//   (coefficients[0] + r coefficients[1] + r^2 coefficients[2]) (point - origin, 1).
struct RowFit {
  struct Axes {
    Mat3 turn = Mat3::zero();
    Vec3 shift = Vec3::zero();
    const Vec3& col(int i) const { return i < 3 ? turn.col(i) : shift; }
    Vec3 operator*(const Vec3& from_origin) const { return turn * from_origin + shift; }
    friend Axes operator*(const Mat3& m, const Axes& a) { return {m * a.turn, m * a.shift}; }
    friend Axes operator*(double s, const Axes& a) { return {s * a.turn, s * a.shift}; }
    friend Axes operator/(const Axes& a, double s) { return {a.turn / s, a.shift / s}; }
    friend Axes operator+(const Axes& a, const Axes& b) { return {a.turn + b.turn, a.shift + b.shift}; }
    friend Axes operator-(const Axes& a, const Axes& b) { return {a.turn - b.turn, a.shift - b.shift}; }
  };

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
