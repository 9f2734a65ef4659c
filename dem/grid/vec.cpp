#include "dem/grid/vec.h"

namespace selenograph {

template <>
Vec3 Vec3::unit_orthogonal() const {
  constexpr double kNegligible = 1e-12;
  // Across x and y, unless both are next to nothing.
  if (std::abs(x()) > kNegligible * std::abs(z()) || std::abs(y()) > kNegligible * std::abs(z())) {
    const double inverse_norm = 1 / xy().norm();
    return {-y() * inverse_norm, x() * inverse_norm, 0};
  }
  const double inverse_norm = 1 / Vec2(y(), z()).norm();
  return {0, -z() * inverse_norm, y() * inverse_norm};
}

Mat2 Mat2::inverse() const {
  const double inverse_determinant = 1 / determinant();
  return from_rows({column[1][1] * inverse_determinant, -column[1][0] * inverse_determinant},
                   {-column[0][1] * inverse_determinant, column[0][0] * inverse_determinant});
}

template <>
double Mat3::determinant() const {
  const auto product = [&](int a, int b, int c) {
    return column[a][0] * (column[b][1] * column[c][2] - column[c][1] * column[b][2]);
  };
  return product(0, 1, 2) - product(1, 0, 2) + product(2, 0, 1);
}

template <>
Mat3 Mat3::inverse() const {
  // The rows of the adjugate are cross products of columns.
  const Vec3 row_0 = col(1).cross(col(2)), row_1 = col(2).cross(col(0)), row_2 = col(0).cross(col(1));
  const double inverse_determinant = 1 / row_0.dot(col(0));
  return from_rows(row_0 * inverse_determinant, row_1 * inverse_determinant, row_2 * inverse_determinant);
}

}  // namespace selenograph
