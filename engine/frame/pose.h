// Position and attitude of a camera. `camera_from_moon` rotates MOON_ME vectors into camera axes.
#pragma once

#include <Eigen/Geometry>

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

struct Pose {
  Vec3 position_m = Vec3::Zero();
  Eigen::Quaterniond camera_from_moon = Eigen::Quaterniond::Identity();  // unit quaternion
};

// Constant rates of a camera's motion.
struct Rates {
  Vec3 angular_rate_deg_s = Vec3::Zero();  // about the camera's own axes
  Vec3 velocity_m_s = Vec3::Zero();        // MOON_ME
  bool none() const { return angular_rate_deg_s.isZero(0) && velocity_m_s.isZero(0); }
};

// Returns the pose after `seconds` of motion at these rates.
Pose moved(const Pose& pose, const Rates& rates, double seconds);

}  // namespace selenograph::engine
