#include "engine/frame/pose.h"

namespace selenograph::engine {

Pose moved(const Pose& pose, const Rates& rates, double seconds) {
  const Vec3 turn = rates.angular_rate_deg_s * (kRadiansPerDegree * seconds);
  const double angle = turn.norm();
  Pose later = pose;
  later.position_m += rates.velocity_m_s * seconds;
  // From the camera, the Moon turns in the opposite direction.
  if (angle > 0) later.camera_from_moon = (AngleAxis(-angle, turn / angle) * pose.camera_from_moon).normalized();
  return later;
}

}  // namespace selenograph::engine
