// ERFA's arrays of rows from and to the engine's vectors.
#pragma once

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// The position and velocity of a body: au and au per day, or m and m/s.
struct PositionVelocity {
  Vec3 position, velocity;
  friend PositionVelocity operator+(const PositionVelocity& a, const PositionVelocity& b) {
    return {a.position + b.position, a.velocity + b.velocity};
  }
  friend PositionVelocity operator-(const PositionVelocity& a, const PositionVelocity& b) {
    return {a.position - b.position, a.velocity - b.velocity};
  }
};

struct ErfaMotion {
  ErfaMotion() = default;
  explicit ErfaMotion(const PositionVelocity& m)
      : rows{{m.position[0], m.position[1], m.position[2]}, {m.velocity[0], m.velocity[1], m.velocity[2]}} {}
  PositionVelocity motion() const { return {Vec3(rows[0]), Vec3(rows[1])}; }

  double rows[2][3];
};

struct ErfaRotation {
  Mat3 matrix() const { return Mat3::from_rows(Vec3(rows[0]), Vec3(rows[1]), Vec3(rows[2])); }

  double rows[3][3];
};

}  // namespace selenograph::engine
