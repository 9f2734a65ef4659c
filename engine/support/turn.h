// The shortest turn from one direction to another.
#pragma once

#include "dem/grid/geodesy.h"
#include "dem/grid/rotation.h"

namespace selenograph::engine {

// Returns the rotation by the smallest angle that takes `from` to `to`, of any lengths; of opposite directions, by 180
// degrees about some axis across them. Eigen's own FromTwoVectors solves that case by a decomposition of matrices,
// which every file that calls it compiles.
Quat shortest_turn(const Vec3& from, const Vec3& to);

}  // namespace selenograph::engine
