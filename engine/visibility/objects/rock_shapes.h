// Shapes of rocks: a few meshes, deformed and rotated by hash.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "engine/frame/objects.h"

namespace selenograph::engine {

// Angular stones: a flattened sphere cut by planes. The largest horizontal extent is 1; the origin is at ground level,
// z is up. They are 0.5 to 0.7 of their diameter high (lunar boulders: 0.6 on average, Demidov & Basilevsky 2014), with
// a third of the height below ground. Made once.
const std::vector<std::shared_ptr<const ObjectMesh>>& rock_shapes();

// Shape and orientation of a rock (dem::Rock) where the ground's normal is `up`.
struct RockPose {
  std::size_t shape;
  Eigen::Quaterniond moon_from_rock;
};
RockPose rock_pose(std::uint64_t form, const Vec3& up);

}  // namespace selenograph::engine
