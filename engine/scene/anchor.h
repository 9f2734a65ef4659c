// The origin of a frame's float coordinates.
#pragma once

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// Returns the origin of a frame's float coordinates: near the camera or, for a distant camera, near the surface in the
// view's middle. It is snapped to a lattice of 4096 m, so that consecutive frames share it; if nothing is nearer to the
// camera than `clearance_m`, to a lattice of up to four times that, at most 32768 m. Float then resolves a microradian
// as seen from the camera.
Vec3 anchor_for(const Vec3& camera_m, const Vec3& middle, double clearance_m = 0);

}  // namespace selenograph::engine
