// Where a frame's float coordinates begin.
#pragma once

#include "dem/grid/geodesy.h"

namespace selenograph::engine {

// Of a frame's float coordinates: near the camera, or, far away, near the surface in the view's middle; snapped to a
// lattice so that consecutive frames share it: of 4096 m, or, where nothing is nearer to the camera than `clearance_m`,
// of up to four times that, at most 32768 m. Float then resolves a microradian as the camera sees it.
Vec3 anchor_for(const Vec3& camera_m, const Vec3& middle, double clearance_m = 0);

}  // namespace selenograph::engine
