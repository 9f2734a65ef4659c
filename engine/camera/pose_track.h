// Camera pose as a function of time while the rows of a frame are exposed.
#pragma once

#include <vector>

#include "engine/frame/pose.h"
#include "engine/frame/shutter.h"

namespace selenograph::engine {

// With constant rates: engine::moved. Through timed poses: positions by cubic Hermite polynomials whose velocity at
// each pose is that of the parabola through it and its two neighbours (Catmull & Rom 1974, for uneven times), which
// follows an orbit's arc; attitudes by slerp (Shoemake 1985), a constant rate from each pose to the next, the shorter
// way. Two poses give constant rates. Velocity and rate are held before the first and after the last pose.
class PoseTrack {
 public:
  // `start`: the pose of row 0; unused when the shutter has poses.
  PoseTrack(const Pose& start, const Shutter& shutter) : PoseTrack(start, shutter.rates, shutter.poses) {}
  PoseTrack(const Pose& start, const Rates& rates, std::vector<PoseAtTime> poses);

  // Seconds from the exposure of row 0.
  Pose at(double seconds) const;
  // Velocity and angular rate then, as a camera's constant ones are given.
  Rates rates_at(double seconds) const;

 private:
  std::size_t segment_of(double seconds) const;
  Vec3 position_at(std::size_t segment, double seconds) const;
  Vec3 velocity_at(std::size_t segment, double seconds) const;

  Pose start_;
  Rates rates_;
  std::vector<PoseAtTime> poses_;
  std::vector<Vec3> velocities_;          // at the poses, m/s
  std::vector<Eigen::AngleAxisd> turns_;  // from each pose's attitude to the next one's
};

}  // namespace selenograph::engine
