// Camera pose as a function of time while the rows of a frame are exposed.
#pragma once

#include <vector>

#include "dem/grid/rotation.h"
#include "engine/frame/pose.h"
#include "engine/frame/shutter.h"

namespace selenograph::engine {

// Two ways to move: at constant rates (engine::moved), or through timed poses. Positions then follow cubic Hermite
// polynomials, whose velocity at each pose is that of the parabola through it and its two neighbours (Catmull & Rom
// 1974, for uneven times); this follows an orbit's arc. Attitudes turn by slerp (Shoemake 1985), at a constant rate
// from each pose to the next, along the shorter arc. Two poses give constant rates. Velocity and rate are constant
// before the first and after the last pose.
class PoseTrack {
 public:
  // `start`: the pose of row 0; unused if the shutter has poses.
  PoseTrack(const Pose& start, const Shutter& shutter) : PoseTrack(start, shutter.rates, shutter.poses) {}
  PoseTrack(const Pose& start, const Rates& rates, std::vector<PoseAtTime> poses);

  // Returns the pose at a time, seconds from the exposure of row 0.
  Pose at(double seconds) const;
  // Returns velocity and angular rate at a time, in the form of a shutter's constant rates.
  Rates rates_at(double seconds) const;

 private:
  std::size_t segment_of(double seconds) const;
  Vec3 position_at(std::size_t segment, double seconds) const;
  Vec3 velocity_at(std::size_t segment, double seconds) const;

  Pose start_;
  Rates rates_;
  std::vector<PoseAtTime> poses_;
  std::vector<Vec3> velocities_;  // velocities at the poses, m/s
  std::vector<AngleAxis> turns_;  // rotation from each pose's attitude to the next
};

}  // namespace selenograph::engine
