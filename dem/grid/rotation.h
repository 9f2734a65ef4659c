// Rotations: by an axis and an angle, and as quaternions.
#pragma once

#include <cmath>

#include "dem/grid/vec.h"

namespace selenograph {

struct Quat;

struct AngleAxis {
  double angle_rad = 0;
  Vec3 axis = Vec3::unit_x();  // unit vector

  AngleAxis(double angle_rad_, const Vec3& axis_) : angle_rad(angle_rad_), axis(axis_) {}
  // The rotation of a unit quaternion or a rotation matrix, by 0 to 180 degrees.
  explicit AngleAxis(const Quat& rotation);
  explicit AngleAxis(const Mat3& rotation);
  Mat3 matrix() const;
  Vec3 operator*(const Vec3& v) const { return matrix() * v; }
};

// w + x i + y j + z k. A rotation is a unit quaternion.
struct Quat {
  double w = 1, x = 0, y = 0, z = 0;

  Quat() = default;
  Quat(double w_, double x_, double y_, double z_) : w(w_), x(x_), y(y_), z(z_) {}
  Quat(const AngleAxis& rotation);
  explicit Quat(const Mat3& rotation);
  static Quat identity() { return {}; }
  bool operator==(const Quat&) const = default;

  Vec3 operator*(const Vec3& v) const;
  Vec3 vec() const { return {x, y, z}; }
  Quat conjugate() const { return {w, -x, -y, -z}; }
  double squared_norm() const { return (x * x + z * z) + (y * y + w * w); }
  double norm() const { return std::sqrt(squared_norm()); }
  Quat normalized() const;
  Mat3 matrix() const;
  // Returns the angle between two rotations, rad.
  double angle_to(const Quat& b) const;
};

// Returns the rotation by b, then by a.
Quat operator*(const Quat& a, const Quat& b);

// Returns the rotation by the smallest angle that takes `from` to `to`, of any lengths; of opposite directions, by 180
// degrees about some axis across them.
Quat shortest_turn(const Vec3& from, const Vec3& to);

}  // namespace selenograph
