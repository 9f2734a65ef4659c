// What rocks look like: a handful of shapes, deformed and turned by hash.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "engine/frame/objects.h"

namespace selenograph::engine {

// Angular stones: a ball, flattened, that planes have cut pieces off. The largest horizontal extent is 1, the origin
// where it leaves the ground, z up: from 0.5 to 0.7 of its diameter high (lunar boulders: 0.6 on average, Demidov &
// Basilevsky 2014), and a third as deep in the ground. Made once.
const std::vector<std::shared_ptr<const ObjectMesh>>& rock_shapes();

// Of a rock of such a form (dem::Rock): which shape, and how it stands where the ground's normal is `up`.
struct RockPose {
  std::size_t shape;
  Eigen::Quaterniond moon_from_rock;
};
RockPose rock_pose(std::uint64_t form, const Vec3& up);

}  // namespace selenograph::engine
