// Arrays of three columns as ERFA's functions take them, and the matrices that the rest of the engine computes with.
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

// Position and velocity: au and au per day, or m and m/s.
using ErfaMotion = ErfaRows<2>;
using PositionVelocity = ErfaMotion::Matrix;

}  // namespace selenograph::engine
