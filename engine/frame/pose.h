// Position and attitude of a camera. `camera_from_moon` rotates MOON_ME vectors into camera axes.
#pragma once

#include "dem/grid/geodesy.h"
#include "dem/grid/rotation.h"

namespace selenograph::engine {

struct Pose {
  Vec3 position_m = Vec3::zero();
  Quat camera_from_moon = Quat::identity();  // unit quaternion
};

// Constant rates of a camera's motion.
struct Rates {
  Vec3 angular_rate_deg_s = Vec3::zero();  // about the camera's own axes
  Vec3 velocity_m_s = Vec3::zero();        // MOON_ME
  bool none() const { return angular_rate_deg_s == Vec3::zero() && velocity_m_s == Vec3::zero(); }
};

// Returns the pose after `seconds` of motion at these rates.
Pose moved(const Pose& pose, const Rates& rates, double seconds);

}  // namespace selenograph::engine
