// Vectors and matrices of two and three components, as plain structs: every unit compiles them.
//
// The order of the sums is part of recorded answers: double adds the first two terms first, float the last two. The
// last row of a product of matrices of double adds its last two terms first.
#pragma once

#include <algorithm>
#include <cmath>
#include <concepts>

namespace selenograph {

// Returns the sum of three terms, in the order of recorded answers.
template <typename T>
T sum_of_three(T x, T y, T z) {
  if constexpr (std::same_as<T, float>) return x + (y + z);
  return (x + y) + z;
}

template <typename T>
struct Vector2 {
  T at[2];

  Vector2() = default;
  Vector2(T x, T y) : at{x, y} {}
  static Vector2 zero() { return {0, 0}; }

  T& operator[](int i) { return at[i]; }
  const T& operator[](int i) const { return at[i]; }
  T& x() { return at[0]; }
  T& y() { return at[1]; }
  const T& x() const { return at[0]; }
  const T& y() const { return at[1]; }

  Vector2& operator+=(const Vector2& b) { return *this = *this + b; }
  Vector2& operator-=(const Vector2& b) { return *this = *this - b; }
  Vector2& operator*=(T s) { return *this = *this * s; }
  Vector2& operator/=(T s) { return *this = *this / s; }
  friend Vector2 operator+(const Vector2& a, const Vector2& b) { return {a[0] + b[0], a[1] + b[1]}; }
  friend Vector2 operator-(const Vector2& a, const Vector2& b) { return {a[0] - b[0], a[1] - b[1]}; }
  friend Vector2 operator-(const Vector2& a) { return {-a[0], -a[1]}; }
  friend Vector2 operator*(const Vector2& a, T s) { return {a[0] * s, a[1] * s}; }
  friend Vector2 operator*(T s, const Vector2& a) { return {s * a[0], s * a[1]}; }
  friend Vector2 operator/(const Vector2& a, T s) { return {a[0] / s, a[1] / s}; }
  bool operator==(const Vector2&) const = default;

  T dot(const Vector2& b) const { return at[0] * b[0] + at[1] * b[1]; }
  T squared_norm() const { return dot(*this); }
  T norm() const { return std::sqrt(squared_norm()); }
  friend Vector2 min_of(const Vector2& a, const Vector2& b) { return {std::min(a[0], b[0]), std::min(a[1], b[1])}; }
  friend Vector2 max_of(const Vector2& a, const Vector2& b) { return {std::max(a[0], b[0]), std::max(a[1], b[1])}; }
  // Returns the largest absolute component.
  T max_abs() const { return std::max(std::abs(at[0]), std::abs(at[1])); }
  bool is_finite() const { return std::isfinite(at[0]) && std::isfinite(at[1]); }
};

template <typename T>
struct Vector3 {
  T at[3];

  Vector3() = default;
  Vector3(T x, T y, T z) : at{x, y, z} {}
  explicit Vector3(const T* xyz) : at{xyz[0], xyz[1], xyz[2]} {}
  static Vector3 constant(T value) { return {value, value, value}; }
  static Vector3 zero() { return {0, 0, 0}; }
  static Vector3 unit_x() { return {1, 0, 0}; }
  static Vector3 unit_y() { return {0, 1, 0}; }
  static Vector3 unit_z() { return {0, 0, 1}; }

  T& operator[](int i) { return at[i]; }
  const T& operator[](int i) const { return at[i]; }
  T& x() { return at[0]; }
  T& y() { return at[1]; }
  T& z() { return at[2]; }
  const T& x() const { return at[0]; }
  const T& y() const { return at[1]; }
  const T& z() const { return at[2]; }
  T* data() { return at; }
  const T* data() const { return at; }
  const T* begin() const { return at; }
  const T* end() const { return at + 3; }
  Vector2<T> xy() const { return {at[0], at[1]}; }
  template <typename U>
  Vector3<U> cast() const {
    return {static_cast<U>(at[0]), static_cast<U>(at[1]), static_cast<U>(at[2])};
  }

  Vector3& operator+=(const Vector3& b) { return *this = *this + b; }
  Vector3& operator-=(const Vector3& b) { return *this = *this - b; }
  Vector3& operator*=(T s) { return *this = *this * s; }
  Vector3& operator/=(T s) { return *this = *this / s; }
  friend Vector3 operator+(const Vector3& a, const Vector3& b) { return {a[0] + b[0], a[1] + b[1], a[2] + b[2]}; }
  friend Vector3 operator-(const Vector3& a, const Vector3& b) { return {a[0] - b[0], a[1] - b[1], a[2] - b[2]}; }
  friend Vector3 operator-(const Vector3& a) { return {-a[0], -a[1], -a[2]}; }
  friend Vector3 operator*(const Vector3& a, T s) { return {a[0] * s, a[1] * s, a[2] * s}; }
  friend Vector3 operator*(T s, const Vector3& a) { return {s * a[0], s * a[1], s * a[2]}; }
  friend Vector3 operator/(const Vector3& a, T s) { return {a[0] / s, a[1] / s, a[2] / s}; }
  bool operator==(const Vector3&) const = default;

  T dot(const Vector3& b) const { return sum_of_three(at[0] * b[0], at[1] * b[1], at[2] * b[2]); }
  Vector3 cross(const Vector3& b) const {
    return {at[1] * b[2] - at[2] * b[1], at[2] * b[0] - at[0] * b[2], at[0] * b[1] - at[1] * b[0]};
  }
  T squared_norm() const { return dot(*this); }
  T norm() const { return std::sqrt(squared_norm()); }
  // Returns the vector itself if its length is 0 or NaN.
  Vector3 normalized() const {
    const T square = squared_norm();
    return square > 0 ? *this / std::sqrt(square) : *this;
  }
  void normalize() { *this = normalized(); }
  // The same where the squares of the components are not representable.
  Vector3 stable_normalized() const {
    const T largest = max_abs();
    const Vector3 scaled = *this / largest;
    const T square = scaled.squared_norm();
    return square > 0 ? *this / (std::sqrt(square) * largest) : *this;
  }
  // Returns some unit vector across this one.
  Vector3 unit_orthogonal() const;
  friend Vector3 min_of(const Vector3& a, const Vector3& b) {
    return {std::min(a[0], b[0]), std::min(a[1], b[1]), std::min(a[2], b[2])};
  }
  friend Vector3 max_of(const Vector3& a, const Vector3& b) {
    return {std::max(a[0], b[0]), std::max(a[1], b[1]), std::max(a[2], b[2])};
  }
  // Returns the largest absolute component.
  T max_abs() const { return std::max(std::max(std::abs(at[0]), std::abs(at[1])), std::abs(at[2])); }
  // Returns true if no component is larger, nor NaN.
  bool is_within(T limit) const {
    return std::abs(at[0]) <= limit && std::abs(at[1]) <= limit && std::abs(at[2]) <= limit;
  }
  bool is_finite() const { return std::isfinite(at[0]) && std::isfinite(at[1]) && std::isfinite(at[2]); }
  bool has_nan() const { return std::isnan(at[0]) || std::isnan(at[1]) || std::isnan(at[2]); }
};

using Vec2 = Vector2<double>;
using Vec2i = Vector2<int>;
using Vec3 = Vector3<double>;
using Vec3f = Vector3<float>;

// A matrix stored by columns.
struct Mat2 {
  Vec2 column[2];

  Mat2() = default;
  Mat2(const Vec2& column_0, const Vec2& column_1) : column{column_0, column_1} {}
  static Mat2 from_rows(const Vec2& row_0, const Vec2& row_1) { return {{row_0[0], row_1[0]}, {row_0[1], row_1[1]}}; }
  static Mat2 zero() { return {{0, 0}, {0, 0}}; }
  static Mat2 identity() { return {{1, 0}, {0, 1}}; }

  double operator()(int r, int c) const { return column[c][r]; }
  double& operator()(int r, int c) { return column[c][r]; }
  const Vec2& col(int c) const { return column[c]; }
  Vec2& col(int c) { return column[c]; }
  Vec2 row(int r) const { return {column[0][r], column[1][r]}; }

  Mat2& operator+=(const Mat2& b) { return *this = *this + b; }
  friend Mat2 operator+(const Mat2& a, const Mat2& b) { return {a.col(0) + b.col(0), a.col(1) + b.col(1)}; }
  friend Mat2 operator-(const Mat2& a, const Mat2& b) { return {a.col(0) - b.col(0), a.col(1) - b.col(1)}; }
  friend Mat2 operator*(double s, const Mat2& a) { return {s * a.col(0), s * a.col(1)}; }
  friend Mat2 operator/(const Mat2& a, double s) { return {a.col(0) / s, a.col(1) / s}; }
  Vec2 operator*(const Vec2& v) const { return {row(0).dot(v), row(1).dot(v)}; }
  Mat2 operator*(const Mat2& b) const { return {*this * b.col(0), *this * b.col(1)}; }
  bool operator==(const Mat2&) const = default;

  Mat2 transpose() const { return {row(0), row(1)}; }
  double trace() const { return column[0][0] + column[1][1]; }
  double determinant() const { return column[0][0] * column[1][1] - column[0][1] * column[1][0]; }
  Mat2 inverse() const;
  // Frobenius norm.
  double norm() const { return std::sqrt(row(0).squared_norm() + row(1).squared_norm()); }
};
inline Mat2 outer(const Vec2& a, const Vec2& b) { return {a * b[0], a * b[1]}; }

// A matrix stored by columns.
template <typename T>
struct Matrix3 {
  using Column = Vector3<T>;
  Column column[3];

  Matrix3() = default;
  Matrix3(const Column& column_0, const Column& column_1, const Column& column_2)
      : column{column_0, column_1, column_2} {}
  static Matrix3 from_rows(const Column& row_0, const Column& row_1, const Column& row_2) {
    return Matrix3(row_0, row_1, row_2).transpose();
  }
  static Matrix3 zero() { return {Column::zero(), Column::zero(), Column::zero()}; }
  static Matrix3 diagonal(const Column& d) { return {{d[0], 0, 0}, {0, d[1], 0}, {0, 0, d[2]}}; }
  static Matrix3 identity() { return {Column::unit_x(), Column::unit_y(), Column::unit_z()}; }

  T operator()(int r, int c) const { return column[c][r]; }
  T& operator()(int r, int c) { return column[c][r]; }
  const Column& col(int c) const { return column[c]; }
  Column& col(int c) { return column[c]; }
  Column row(int r) const { return {column[0][r], column[1][r], column[2][r]}; }
  // Returns the nine elements, column by column.
  const T* data() const { return reinterpret_cast<const T*>(this); }
  template <typename U>
  Matrix3<U> cast() const {
    return {column[0].template cast<U>(), column[1].template cast<U>(), column[2].template cast<U>()};
  }

  Matrix3& operator+=(const Matrix3& b) { return *this = *this + b; }
  friend Matrix3 operator+(const Matrix3& a, const Matrix3& b) {
    return {a.col(0) + b.col(0), a.col(1) + b.col(1), a.col(2) + b.col(2)};
  }
  friend Matrix3 operator-(const Matrix3& a, const Matrix3& b) {
    return {a.col(0) - b.col(0), a.col(1) - b.col(1), a.col(2) - b.col(2)};
  }
  friend Matrix3 operator-(const Matrix3& a) { return {-a.col(0), -a.col(1), -a.col(2)}; }
  friend Matrix3 operator*(T s, const Matrix3& a) { return {s * a.col(0), s * a.col(1), s * a.col(2)}; }
  friend Matrix3 operator/(const Matrix3& a, T s) { return {a.col(0) / s, a.col(1) / s, a.col(2) / s}; }
  Column operator*(const Column& v) const {
    return {row(0).dot(v), row(1).dot(v), column[0][2] * v[0] + (column[1][2] * v[1] + column[2][2] * v[2])};
  }
  Matrix3 operator*(const Matrix3& b) const { return {*this * b.col(0), *this * b.col(1), *this * b.col(2)}; }
  // Multiplies by the transpose of this matrix.
  Column transpose_times(const Column& v) const { return {column[0].dot(v), column[1].dot(v), column[2].dot(v)}; }
  Matrix3 transpose_times(const Matrix3& b) const {
    return {transpose_times(b.col(0)), transpose_times(b.col(1)), transpose_times(b.col(2))};
  }
  bool operator==(const Matrix3&) const = default;

  Matrix3 transpose() const { return {row(0), row(1), row(2)}; }
  T determinant() const;
  Matrix3 inverse() const;
  // Frobenius norm.
  T norm() const { return std::sqrt(column[0].squared_norm() + column[1].squared_norm() + column[2].squared_norm()); }
  T max_abs() const { return std::max(std::max(column[0].max_abs(), column[1].max_abs()), column[2].max_abs()); }
  bool is_finite() const { return column[0].is_finite() && column[1].is_finite() && column[2].is_finite(); }
};

using Mat3 = Matrix3<double>;
using Mat3f = Matrix3<float>;

template <>
Vec3 Vec3::unit_orthogonal() const;
template <>
double Mat3::determinant() const;
template <>
Mat3 Mat3::inverse() const;

}  // namespace selenograph
