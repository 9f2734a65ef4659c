#include "dem/grid/rotation.h"

#include <numbers>

namespace selenograph {

AngleAxis::AngleAxis(const Quat& rotation) {
  const Vec3 vec = rotation.vec();
  const double length = vec.norm();
  if (length == 0) return;
  angle_rad = 2 * std::atan2(length, std::abs(rotation.w));
  axis = vec / (rotation.w < 0 ? -length : length);
}

AngleAxis::AngleAxis(const Mat3& rotation) : AngleAxis(Quat(rotation)) {}

// Rodrigues's formula.
Mat3 AngleAxis::matrix() const {
  const double cosine = std::cos(angle_rad);
  const Vec3 s = std::sin(angle_rad) * axis, c = (1 - cosine) * axis;
  const double xy = c.x() * axis.y(), xz = c.x() * axis.z(), yz = c.y() * axis.z();
  return {{c.x() * axis.x() + cosine, xy + s.z(), xz - s.y()},
          {xy - s.z(), c.y() * axis.y() + cosine, yz + s.x()},
          {xz + s.y(), yz - s.x(), c.z() * axis.z() + cosine}};
}

Quat::Quat(const AngleAxis& rotation) {
  const double half = 0.5 * rotation.angle_rad;
  const Vec3 vec = std::sin(half) * rotation.axis;
  *this = {std::cos(half), vec.x(), vec.y(), vec.z()};
}

// Shoemake 1987: divides by the largest component.
Quat::Quat(const Mat3& m) {
  const double trace = m(0, 0) + (m(1, 1) + m(2, 2));
  if (trace > 0) {
    const double root = std::sqrt(trace + 1), scale = 0.5 / root;
    *this = {0.5 * root, (m(2, 1) - m(1, 2)) * scale, (m(0, 2) - m(2, 0)) * scale, (m(1, 0) - m(0, 1)) * scale};
    return;
  }
  int i = m(1, 1) > m(0, 0) ? 1 : 0;
  if (m(2, 2) > m(i, i)) i = 2;
  const int j = (i + 1) % 3, k = (j + 1) % 3;
  const double root = std::sqrt(m(i, i) - m(j, j) - m(k, k) + 1), scale = 0.5 / root;
  Vec3 vec;
  vec[i] = 0.5 * root;
  vec[j] = (m(j, i) + m(i, j)) * scale;
  vec[k] = (m(k, i) + m(i, k)) * scale;
  *this = {(m(k, j) - m(j, k)) * scale, vec.x(), vec.y(), vec.z()};
}

Vec3 Quat::operator*(const Vec3& v) const {
  const Vec3 half = vec().cross(v), across = half + half;
  return v + w * across + vec().cross(across);
}

Quat Quat::normalized() const {
  const double length = norm();
  return length > 0 ? Quat(w / length, x / length, y / length, z / length) : *this;
}

Mat3 Quat::matrix() const {
  const double tx = 2 * x, ty = 2 * y, tz = 2 * z;
  const double twx = tx * w, twy = ty * w, twz = tz * w;
  const double txx = tx * x, txy = ty * x, txz = tz * x, tyy = ty * y, tyz = tz * y, tzz = tz * z;
  return {{1 - (tyy + tzz), txy + twz, txz - twy},
          {txy - twz, 1 - (txx + tzz), tyz + twx},
          {txz + twy, tyz - twx, 1 - (txx + tyy)}};
}

double Quat::angle_to(const Quat& b) const {
  const Quat turn = *this * b.conjugate();
  return 2 * std::atan2(turn.vec().norm(), std::abs(turn.w));
}

Quat operator*(const Quat& a, const Quat& b) {
  return {(a.w * b.w - a.y * b.y) - (a.z * b.z + a.x * b.x), (a.w * b.x + a.y * b.z) - (a.z * b.y - a.x * b.w),
          (a.w * b.y + a.y * b.w) + (a.z * b.x - a.x * b.z), (a.w * b.z - a.y * b.x) + (a.z * b.w + a.x * b.y)};
}

Quat shortest_turn(const Vec3& from, const Vec3& to) {
  const Vec3 a = from.normalized(), b = to.normalized();
  const double cosine = b.dot(a);
  constexpr double kOpposite = 1e-12;
  if (cosine < -1 + kOpposite) return Quat(AngleAxis(std::numbers::pi, a.unit_orthogonal()));
  const double twice_cosine_of_half = std::sqrt((1 + cosine) * 2);
  const Vec3 axis = a.cross(b) * (1 / twice_cosine_of_half);
  return {twice_cosine_of_half * 0.5, axis.x(), axis.y(), axis.z()};
}

}  // namespace selenograph
