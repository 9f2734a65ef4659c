// Where a camera is and where it looks. `camera_from_moon` rotates MOON_ME vectors into camera axes.
#pragma once

#include <Eigen/Geometry>

#include "dem/geodesy.h"

namespace selenograph::engine {

struct Pose {
  Vec3 position_m = Vec3::Zero();
  Eigen::Quaterniond camera_from_moon = Eigen::Quaterniond::Identity();  // unit
};

}  // namespace selenograph::engine
