// Converts between ERFA's arrays of three columns and the engine's matrices.
#pragma once

#include <Eigen/Core>
#include <cstring>

namespace selenograph::engine {

template <int kRows>
struct ErfaRows {
  using Matrix = Eigen::Matrix<double, kRows, 3, Eigen::RowMajor>;

  ErfaRows() = default;
  explicit ErfaRows(const Matrix& matrix) { std::memcpy(rows, matrix.data(), sizeof rows); }
  Matrix matrix() const {
    Matrix out;
    std::memcpy(out.data(), rows, sizeof rows);
    return out;
  }

  double rows[kRows][3];
};

// Position (row 0) and velocity (row 1): au and au per day, or m and m/s.
using ErfaMotion = ErfaRows<2>;
using PositionVelocity = ErfaMotion::Matrix;

}  // namespace selenograph::engine
